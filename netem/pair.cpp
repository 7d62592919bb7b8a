#include "netem/pair.hpp"

#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <optional>
#include <thread>
#include <utility>

extern char** environ;

namespace tactus::netem {
namespace {

constexpr char kPrefix[] = "tactus-link-";
constexpr char kDevice[] = "link0";
constexpr char kNamespaces[] = "/run/netns";
constexpr std::array kMacs{"02:00:00:00:77:01", "02:00:00:00:77:02"};
constexpr int kRelayPriority = 80;  // above the programs whose frames it carries
constexpr char kRemedy[] =
    "namespaces and tap devices need root (CAP_SYS_ADMIN and CAP_NET_ADMIN): run it with sudo, in a container with "
    "--privileged";

/// Owns a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int fd = -1) noexcept : fd_{fd} {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(Descriptor&& other) noexcept : fd_{std::exchange(other.fd_, -1)} {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  [[nodiscard]] int get() const noexcept { return fd_; }

 private:
  int fd_;
};

[[noreturn]] void fail(const std::string& what, int error) {
  std::string text = what + ": " + std::strerror(error);
  if (error == EPERM || error == EACCES) text += std::string{"; "} + kRemedy;
  throw LinkError(text);
}

/// Runs `ip` or `tc` of iproute2 with the lines of `script`. Throws LinkError with its output.
void batch(std::vector<std::string> command, const std::string& script) {
  const Descriptor input{::memfd_create("input", MFD_CLOEXEC)}, output{::memfd_create("output", MFD_CLOEXEC)};
  if (input.get() < 0 || output.get() < 0) fail("cannot create a memory file", errno);
  if (::write(input.get(), script.data(), script.size()) < 0) fail("cannot write a memory file", errno);
  ::lseek(input.get(), 0, SEEK_SET);
  command.insert(command.end(), {"-batch", "-"});
  std::vector<char*> argv;
  for (std::string& word : command) argv.push_back(word.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, input.get(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, output.get(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, output.get(), STDERR_FILENO);
  pid_t child = 0;
  int error = ::posix_spawnp(&child, argv[0], &actions, nullptr, argv.data(), environ);
  if (error == ENOENT) {  // /sbin may be missing in PATH
    const std::string in_sbin = "/sbin/" + command[0];
    error = ::posix_spawn(&child, in_sbin.c_str(), &actions, nullptr, argv.data(), environ);
  }
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) throw LinkError("no command '" + command[0] + "'; install the Debian package iproute2");
  if (error != 0) fail("cannot start " + command[0], error);
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return;
  std::array<char, 512> output_text{};
  const ssize_t bytes = ::pread(output.get(), output_text.data(), output_text.size(), 0);
  throw LinkError(command[0] + " failed:\n" + script +
                  "output: " + std::string(output_text.data(), bytes > 0 ? static_cast<std::size_t>(bytes) : 0));
}

Descriptor open_namespace(const std::string& path) {
  Descriptor made{::open(path.c_str(), O_RDONLY | O_CLOEXEC)};
  if (made.get() < 0) fail("cannot open " + path, errno);
  return made;
}

void set_namespace(const Descriptor& where) {
  if (::setns(where.get(), CLONE_NEWNET) != 0) fail("cannot enter a network namespace", errno);
}

/// Creates a tap device named kDevice in the network namespace of the calling thread.
Descriptor make_tap() {
  Descriptor tap{::open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC)};
  if (tap.get() < 0) {
    const int error = errno;
    if (error == ENOENT || error == ENODEV || error == ENXIO)
      throw LinkError(
          "no /dev/net/tun; load the module (modprobe tun), or pass the device into the container "
          "(--device /dev/net/tun)");
    fail("cannot open /dev/net/tun", error);
  }
  ifreq request{};
  std::strcpy(request.ifr_name, kDevice);
  request.ifr_flags = IFF_TAP | IFF_NO_PI;
  if (::ioctl(tap.get(), TUNSETIFF, &request) != 0) fail("cannot make a tap device", errno);
  return tap;
}

/// Returns the script that sets address, route and neighbour of one side.
std::string device_script(Side side) {
  const auto own = static_cast<std::size_t>(side);
  const Side other = side == Side::kA ? Side::kB : Side::kA;
  const std::string device = kDevice;
  return "link set lo up\n"
         "link set " +
         device +
         " addrgenmode none\n"
         "link set " +
         device + " address " + kMacs[own] +
         "\n"
         "link set " +
         device +
         " txqueuelen 1000\n"
         "link set " +
         device +
         " up\n"
         "addr add " +
         LinkedPair::address(side) + "/24 dev " + device +
         "\n"
         "neigh replace " +
         LinkedPair::address(other) + " lladdr " + kMacs[1 - own] + " nud permanent dev " + device +
         "\n"
         "route add 224.0.0.0/4 dev " +
         device + "\n";
}

/// Waits until the device in the calling thread's namespace passes frames, which it does shortly after both ends are
/// up.
void wait_running() {
  const Descriptor socket{::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)};
  ifreq request{};
  std::strcpy(request.ifr_name, kDevice);
  constexpr auto kTimeout = std::chrono::seconds{10};
  for (const auto end = std::chrono::steady_clock::now() + kTimeout; std::chrono::steady_clock::now() < end;) {
    if (::ioctl(socket.get(), SIOCGIFFLAGS, &request) != 0)
      fail("cannot read the state of device " + std::string{kDevice}, errno);
    if ((request.ifr_flags & IFF_RUNNING) != 0) return;
    std::this_thread::sleep_for(std::chrono::milliseconds{1});  // polls: ioctl cannot wait
  }
  throw LinkError("device " + std::string{kDevice} + " passes no frames 10 s after it was brought up");
}

/// Returns the script for the kernel's token bucket with three bands by socket priority.
std::string rate_script(const LinkProfile& direction) {
  char text[256];
  std::snprintf(text, sizeof text,
                "qdisc add dev %s root handle 1: tbf rate %.0fkbit burst 3028 limit %u\n"
                "qdisc add dev %s parent 1:1 handle 10: pfifo_fast\n",
                kDevice, direction.rate_mbit * 1e3, direction.queue_bytes, kDevice);
  return text;
}

/// Starts a program in the namespace of the descriptor `network_namespace`; -1 means the caller's namespace.
pid_t start_in(int network_namespace, std::vector<std::string> command) {
  std::vector<char*> argv;
  for (std::string& word : command) argv.push_back(word.data());
  argv.push_back(nullptr);
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child < 0) fail("cannot start '" + command[0] + "'", errno);
  if (child == 0) {  // only async-signal-safe calls until exec
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(128 + SIGKILL);  // the parent ended before prctl
    sigset_t none;
    sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    if (network_namespace < 0 || ::setns(network_namespace, CLONE_NEWNET) == 0) ::execvp(argv[0], argv.data());
    constexpr char kMessage[] = ": cannot be run here\n";
    (void)!::write(STDERR_FILENO, argv[0], std::strlen(argv[0]));
    (void)!::write(STDERR_FILENO, kMessage, sizeof kMessage - 1);
    ::_exit(127);
  }
  ::setpgid(child, child);  // in both processes, because either may run first
  return child;
}

}  // namespace

pid_t start_program(std::vector<std::string> command) { return start_in(-1, std::move(command)); }

std::string missing_privilege() try {
  // A thread of its own, so that the new namespace ends with the thread.
  std::string reason;
  std::thread{[&reason] {
    try {
      if (::unshare(CLONE_NEWNET) != 0) fail("cannot make a network namespace", errno);
      (void)make_tap();
    } catch (const LinkError& error) {
      reason = error.what();
    }
  }}.join();
  if (!reason.empty()) return reason;
  (void)remove_stale();
  // To enter a namespace, `ip` needs a root directory that is a mount point, which is not the case in a chroot.
  static std::atomic<int> tries{0};
  const std::string name = "tactus-link-" + std::to_string(::getpid()) + "-try" + std::to_string(tries++);
  batch({"ip"}, "netns add " + name + "\n");
  try {
    batch({"ip", "-n", name}, "link show lo\n");
  } catch (const LinkError& error) {
    reason = error.what();
  }
  batch({"ip"}, "netns del " + name + "\n");
  return reason;
} catch (const LinkError& error) {
  return error.what();
}

std::vector<std::string> remove_stale() {
  std::vector<std::string> removed;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{kNamespaces, error}) {
    const std::string name = entry.path().filename().string();
    int pid = 0;
    if (std::sscanf(name.c_str(), "tactus-link-%d-", &pid) != 1 || pid <= 0) continue;
    if (::kill(pid, 0) == 0 || errno != ESRCH) continue;
    try {
      batch({"ip"}, "netns del " + name + "\n");
      removed.push_back(name);
    } catch (const LinkError&) {  // another program removed it first
    }
  }
  return removed;
}

struct LinkedPair::Impl {
  std::array<std::string, 2> names;
  std::array<Descriptor, 2> namespaces;
  std::array<Descriptor, 2> taps;
  std::unique_ptr<Relay> relay;
  std::thread carrier;
  bool realtime = true;
  bool named = false;

  ~Impl() {
    if (relay != nullptr) relay->stop();
    if (carrier.joinable()) carrier.join();
    if (!named) return;
    try {
      batch({"ip"}, "netns del " + names[0] + "\nnetns del " + names[1] + "\n");
    } catch (const LinkError&) {  // removed by another program; the next pair removes the rest
    }
  }

  void make(const LinkSettings& settings) {
    const Descriptor home = open_namespace("/proc/thread-self/ns/net");
    static std::atomic<int> count{0};
    const std::string stem =
        kPrefix + std::to_string(::getpid()) + "-" + (count++ == 0 ? "" : std::to_string(count.load() - 1) + "-");
    names = {stem + "a", stem + "b"};
    batch({"ip"}, "netns add " + names[0] + "\nnetns add " + names[1] + "\n");
    named = true;
    for (std::size_t i = 0; i < 2; ++i) namespaces[i] = open_namespace(std::string{kNamespaces} + "/" + names[i]);
    if (settings.medium == Medium::kRelay) {
      for (std::size_t i = 0; i < 2; ++i) {
        set_namespace(namespaces[i]);
        try {
          taps[i] = make_tap();
        } catch (...) {
          set_namespace(home);
          throw;
        }
        set_namespace(home);
      }
    } else {
      const std::string device = kDevice;
      batch({"ip"}, "link add " + device + " netns " + names[0] + " type veth peer name " + device + " netns " +
                        names[1] + "\n");
    }
    for (const Side side : {Side::kA, Side::kB})
      batch({"ip", "-n", names[static_cast<std::size_t>(side)]}, device_script(side));
    if (settings.medium == Medium::kRelay) {
      relay = std::make_unique<Relay>(taps[0].get(), taps[1].get(), settings);
      carry();
    } else {
      if (settings.a_to_b.rate_mbit > 0) batch({"tc", "-n", names[0]}, rate_script(settings.a_to_b));
      if (settings.b_to_a.rate_mbit > 0) batch({"tc", "-n", names[1]}, rate_script(settings.b_to_a));
    }
    for (const Descriptor& where : namespaces) {
      set_namespace(where);
      try {
        wait_running();
      } catch (...) {
        set_namespace(home);
        throw;
      }
      set_namespace(home);
    }
  }

  void carry() {
    // Blocks all signals in the relay's thread, so that the program's other threads receive them.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    carrier = std::thread{[this] { relay->run(); }};
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    sched_param wanted{};
    wanted.sched_priority = kRelayPriority;
    realtime = pthread_setschedparam(carrier.native_handle(), SCHED_FIFO, &wanted) == 0;
  }
};

LinkedPair::LinkedPair(const LinkSettings& settings) : settings_{settings}, impl_{std::make_unique<Impl>()} {
  check(settings);
  if (const std::string reason = missing_privilege(); !reason.empty()) throw LinkError(reason);
  impl_->make(settings);
}

LinkedPair::~LinkedPair() = default;

const std::string& LinkedPair::name(Side side) const { return impl_->names[static_cast<std::size_t>(side)]; }

void LinkedPair::enter_namespace(Side side) const { set_namespace(impl_->namespaces[static_cast<std::size_t>(side)]); }

pid_t LinkedPair::start(Side side, std::vector<std::string> command) const {
  return start_in(impl_->namespaces[static_cast<std::size_t>(side)].get(), std::move(command));
}

void LinkedPair::set_profiles(const LinkProfile& a_to_b, const LinkProfile& b_to_a) {
  if (impl_->relay == nullptr)
    throw LinkError("link " + settings_.name + ": cannot be changed; expected a relay, as P0");
  settings_.a_to_b = a_to_b;
  settings_.b_to_a = b_to_a;
  check(settings_);
  impl_->relay->set_profiles(a_to_b, b_to_a);
}

RelayFigures LinkedPair::figures() const { return impl_->relay != nullptr ? impl_->relay->figures() : RelayFigures{}; }

bool LinkedPair::realtime() const noexcept { return impl_->realtime; }

}  // namespace tactus::netem
