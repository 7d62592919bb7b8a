#include "tools/chaos/programs.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>

namespace tactus::chaos {
namespace {

namespace fs = std::filesystem;

constexpr char kDefaultSession[] = "tactus", kDefaultDomain[] = "20";
constexpr std::chrono::seconds kMaxEnd{10};  // in which a killed program and its children end

fs::path folder_of(pid_t pid) { return fs::path{"/proc"} / std::to_string(pid); }

std::string read_file(const fs::path& path) {
  std::ifstream file{path, std::ios::binary};
  return {std::istreambuf_iterator<char>{file}, {}};
}

/// Splits the content of /proc/PID/cmdline or environ, which ends each text by a zero.
std::vector<std::string> split_at_zeros(const std::string& content) {
  std::vector<std::string> parts;
  std::istringstream in{content};
  for (std::string part; std::getline(in, part, '\0');) parts.push_back(part);
  return parts;
}

/// Returns the value of an option, given as "--name VALUE" or "--name=VALUE"; the last one counts.
std::string option(const std::vector<std::string>& arguments, const std::string& name, const std::string& otherwise) {
  std::string value = otherwise;
  for (std::size_t i = 1; i < arguments.size(); ++i) {
    if (arguments[i] == name && i + 1 < arguments.size()) value = arguments[i + 1];
    if (arguments[i].starts_with(name + "=")) value = arguments[i].substr(name.size() + 1);
  }
  return value;
}

bool has_option(const std::vector<std::string>& arguments, const std::string& name) {
  return std::any_of(arguments.begin(), arguments.end(),
                     [&](const std::string& argument) { return argument == name || argument.starts_with(name + "="); });
}

/// The fields of /proc/PID/stat that identify a running process.
struct Stat {
  char state = 'X';           // Z: ended, but its parent has not read its status
  std::uint64_t started = 0;  // in clock ticks since the start of the machine
};
Stat stat_of(pid_t pid) {
  const std::string text = read_file(folder_of(pid) / "stat");
  std::istringstream fields{text.substr(std::min(text.size(), text.rfind(')') + 1))};
  Stat stat;
  fields >> stat.state;
  constexpr int kStarted = 20;  // of the fields after the name, from 1
  std::string field;
  for (int i = 1; i < kStarted; ++i) fields >> field;
  stat.started = std::strtoull(field.c_str(), nullptr, 10);
  return stat;
}
bool is_running(const Program& program) {
  const Stat stat = stat_of(program.pid);
  return stat.state != 'Z' && stat.state != 'X' && stat.started == program.started;
}

/// Whether this process sees the same files and processes as the other. False for one in a container or chroot.
bool shares_namespaces(pid_t pid) {
  for (const char* name : {"ns/mnt", "ns/pid", "root"}) {
    struct stat theirs {
    }, ours{};
    if (::stat((folder_of(pid) / name).c_str(), &theirs) != 0 ||
        ::stat((fs::path{"/proc/self"} / name).c_str(), &ours) != 0)
      return false;
    if (theirs.st_ino != ours.st_ino || theirs.st_dev != ours.st_dev) return false;
  }
  return true;
}

/// Returns the lines of /proc/PID/status with all ids of user and groups.
std::string rights_of(const fs::path& folder) {
  std::istringstream status{read_file(folder / "status")};
  std::string rights;
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("Uid:") || line.starts_with("Gid:") || line.starts_with("Groups:")) rights += line + '\n';
  return rights;
}

/// Whether this process may start the other again with the same rights. It gives no rights away, and takes none.
bool has_same_rights(pid_t pid) {
  const std::string ours = rights_of("/proc/self");
  return !ours.empty() && rights_of(folder_of(pid)) == ours;
}

/// Whether systemd runs the process as a service of Tactus, and starts it again.
bool is_service_of_systemd(pid_t pid) {
  const std::string group = read_file(folder_of(pid) / "cgroup");
  return group.find("/tactus-host@") != std::string::npos || group.find("/tactus-hrtc@") != std::string::npos;
}

/// Returns the children of all threads of a process.
std::vector<pid_t> children_of(pid_t pid) {
  std::vector<pid_t> children;
  std::error_code none;
  for (fs::directory_iterator at{folder_of(pid) / "task", none}, end; !none && at != end; at.increment(none)) {
    std::istringstream list{read_file(at->path() / "children")};
    for (pid_t child = 0; list >> child;) children.push_back(child);
  }
  return children;
}

/// Sends a signal to the process of a descriptor, as pidfd_send_signal() of later C libraries. Async-signal-safe.
bool send_signal(int process, int number) noexcept {
  return ::syscall(SYS_pidfd_send_signal, process, number, nullptr, 0) == 0;
}

/// The descriptor of a process, which names it even after its id is used again.
class ProcessDescriptor {
 public:
  explicit ProcessDescriptor(pid_t pid) noexcept : descriptor_{static_cast<int>(::syscall(SYS_pidfd_open, pid, 0))} {}
  /// Throws ProgramEnded.
  explicit ProcessDescriptor(const Program& program) : ProcessDescriptor{program.pid} {
    if (descriptor_ < 0 || !is_running(program))
      throw ProgramEnded{program.label + " has ended, or belongs to another user"};
  }
  ProcessDescriptor(ProcessDescriptor&& other) noexcept : descriptor_{std::exchange(other.descriptor_, -1)} {}
  ProcessDescriptor& operator=(ProcessDescriptor&&) = delete;
  ~ProcessDescriptor() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  [[nodiscard]] int get() const noexcept { return descriptor_; }
  /// Waits for the end of the process, also through signals to this one. Returns false after `limit`.
  [[nodiscard]] bool wait_for_end(std::chrono::milliseconds limit) const noexcept {
    const auto end = std::chrono::steady_clock::now() + limit;
    while (descriptor_ >= 0) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
      pollfd ended{descriptor_, POLLIN, 0};
      const int result = ::poll(&ended, 1, static_cast<int>(std::max<std::int64_t>(0, left.count())));
      if (result == 1) return true;
      if (result == 0 || errno != EINTR) return false;
    }
    return true;
  }

 private:
  int descriptor_;
};

/// All that a process needs to start again.
class Command {
 public:
  /// Throws std::runtime_error if the program cannot be started again.
  explicit Command(pid_t pid)
      : program_{fs::read_symlink(folder_of(pid) / "exe")},
        folder_{fs::read_symlink(folder_of(pid) / "cwd")},
        arguments_{split_at_zeros(read_file(folder_of(pid) / "cmdline"))},
        environment_{split_at_zeros(read_file(folder_of(pid) / "environ"))},
        network_{::open((folder_of(pid) / "ns/net").c_str(), O_RDONLY | O_CLOEXEC)} {
    for (std::size_t i = 0; i < outputs_.size(); ++i)
      outputs_[i] = ::open((folder_of(pid) / "fd" / std::to_string(i + 1)).c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
    if (network_ < 0 || arguments_.empty() || ::access(program_.c_str(), X_OK) != 0)
      throw std::runtime_error{program_ + " cannot be started again: " + std::strerror(errno)};
  }
  ~Command() {
    for (const int descriptor : {network_, outputs_[0], outputs_[1]})
      if (descriptor >= 0) ::close(descriptor);
  }
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  /// Starts the program. Throws NotRestarted.
  void start() {
    std::vector<char*> argv, envp;
    for (std::string& argument : arguments_) argv.push_back(argument.data());
    for (std::string& variable : environment_) envp.push_back(variable.data());
    argv.push_back(nullptr);
    envp.push_back(nullptr);
    std::array<int, 2> report{};  // the new process writes an errno; the start of the program closes it
    if (::pipe2(report.data(), O_CLOEXEC) != 0) throw not_restarted(errno);
    const pid_t child = ::_Fork();
    // A second fork: the program is then no child of this process, which need not wait for it.
    if (child == 0) {
      const pid_t successor = ::_Fork();
      if (successor < 0) write_errno(report[1]);
      ::_exit(successor == 0 ? become_program(argv.data(), envp.data(), report[1]) : 0);
    }
    const int fork_error = errno;
    ::close(report[1]);
    if (child > 0) ::waitpid(child, nullptr, 0);
    int error = child < 0 ? fork_error : 0;
    ssize_t size = 0;
    while ((size = ::read(report[0], &error, sizeof error)) < 0 && errno == EINTR) {
    }
    ::close(report[0]);
    if (error != 0) throw not_restarted(error);
  }

 private:
  [[nodiscard]] NotRestarted not_restarted(int error) const {
    return NotRestarted{"cannot start " + program_ + " again: " + std::strerror(error)};
  }
  /// Async-signal-safe.
  static void write_errno(int report) noexcept {
    const int error = errno;
    (void)!::write(report, &error, sizeof error);
  }
  /// Only async-signal-safe calls, because other threads may hold locks. Returns only after a failure, a status.
  int become_program(char** argv, char** envp, int report) const noexcept {
    ::setsid();
    struct stat ours {
    }, theirs{};
    const bool is_elsewhere =
        ::fstat(network_, &theirs) == 0 && ::stat("/proc/self/ns/net", &ours) == 0 && ours.st_ino != theirs.st_ino;
    if ((!is_elsewhere || ::setns(network_, CLONE_NEWNET) == 0) && ::chdir(folder_.c_str()) == 0) {
      ::dup2(::open("/dev/null", O_RDONLY), STDIN_FILENO);
      for (std::size_t i = 0; i < outputs_.size(); ++i)
        ::dup2(outputs_[i] >= 0 ? outputs_[i] : ::open("/dev/null", O_WRONLY), static_cast<int>(i) + 1);
      // The sockets of this process would keep their ports open in the program.
      ::dup2(report, kReport);
      ::fcntl(kReport, F_SETFD, FD_CLOEXEC);
      ::close_range(kReport + 1, ~0u, 0);
      report = kReport;
      ::execve(program_.c_str(), argv, envp);
    }
    write_errno(report);
    return 127;
  }

  static constexpr int kReport = 3;
  std::string program_, folder_;
  std::vector<std::string> arguments_, environment_;
  int network_;                         // descriptor of its network namespace
  std::array<int, 2> outputs_{-1, -1};  // of standard output and error
};

std::optional<Program> program_of(pid_t pid, const std::string& session, int domain, bool may_start) {
  std::error_code none;
  const std::string file = fs::read_symlink(folder_of(pid) / "exe", none).filename();
  static const std::set<std::string> parts_of_a_session{"tactus-host", "tactus-hrtc", "tactus-gateway",
                                                        "tactus-sim",  "tactus-view", "tactus-ros2"};
  if (none || !parts_of_a_session.contains(file)) return std::nullopt;
  const std::vector<std::string> arguments = split_at_zeros(read_file(folder_of(pid) / "cmdline"));
  if (option(arguments, "--session", kDefaultSession) != session) return std::nullopt;
  if (std::atoi(option(arguments, "--domain", kDefaultDomain).c_str()) != domain) return std::nullopt;
  Program program;
  program.pid = pid;
  program.started = stat_of(pid).started;
  const std::string name = option(arguments, "--name", "");
  program.label = file.substr(std::strlen("tactus-")) + (name.empty() ? "" : " " + name);
  program.has_driver = (file == "tactus-hrtc" || file == "tactus-gateway") && has_option(arguments, "--device");
  const bool is_service = file == "tactus-host" || file == "tactus-hrtc";
  const bool has_parent_hrtc = file == "tactus-gateway" && has_option(arguments, "--link");
  if (has_parent_hrtc || (is_service && may_start && is_service_of_systemd(pid)))
    program.restart = Restart::kItsSupervisor;
  else if (is_service && may_start && shares_namespaces(pid) && has_same_rights(pid))
    program.restart = Restart::kChaos;
  return program;
}

}  // namespace

class Suspension::Process : public ProcessDescriptor {
 public:
  using ProcessDescriptor::ProcessDescriptor;
};

std::vector<Program> programs_of(const std::string& session, int domain, bool may_start) {
  std::vector<Program> programs;
  for (const auto& entry : fs::directory_iterator{"/proc"}) {
    const pid_t pid = static_cast<pid_t>(std::strtol(entry.path().filename().c_str(), nullptr, 10));
    if (pid <= 0 || pid == ::getpid()) continue;
    if (auto program = program_of(pid, session, domain, may_start)) programs.push_back(std::move(*program));
  }
  std::sort(programs.begin(), programs.end(), [](const Program& a, const Program& b) {
    return a.label != b.label ? a.label < b.label : a.started < b.started;
  });
  for (std::size_t i = 1, number = 1; i < programs.size(); ++i) {
    number = programs[i].label == programs[i - number].label ? number + 1 : 1;
    if (number > 1) programs[i].label += " (" + std::to_string(number) + ")";
  }
  return programs;
}

std::optional<Resources> resources_of(const Program& program) {
  if (!is_running(program)) return std::nullopt;
  std::istringstream pages{read_file(folder_of(program.pid) / "statm")};
  std::uint64_t total = 0, resident = 0;
  if (!(pages >> total >> resident)) return std::nullopt;
  Resources resources;
  resources.resident_mb = static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE)) * 1e-6;
  std::error_code none;
  for (fs::directory_iterator at{folder_of(program.pid) / "fd", none}, end; !none && at != end; at.increment(none))
    ++resources.descriptors;
  return resources;
}

std::optional<Resources> settled_resources_of(const Program& program, std::size_t descriptors,
                                              std::chrono::milliseconds limit) {
  constexpr std::chrono::milliseconds kBetweenReads{20};
  std::optional<Resources> fewest = resources_of(program);
  const auto end = std::chrono::steady_clock::now() + limit;
  while (fewest && fewest->descriptors > descriptors && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(kBetweenReads);  // nothing notifies of a closed descriptor
    const std::optional<Resources> next = resources_of(program);
    if (!next) return std::nullopt;
    if (next->descriptors < fewest->descriptors) fewest = next;
  }
  return fewest;
}

double age_of(const Program& program) {
  timespec now{};
  ::clock_gettime(CLOCK_BOOTTIME, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec) -
         static_cast<double>(program.started) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

Suspension::Suspension(const Program& program, double seconds)
    : process_{std::make_unique<Process>(program)}, child_{::_Fork()} {
  if (child_ == 0) {
    ::setsid();  // Ctrl-C does not end the child, which resumes the program in any case
    const timespec time{static_cast<time_t>(seconds), static_cast<long>((seconds - std::floor(seconds)) * 1e9)};
    ::nanosleep(&time, nullptr);
    send_signal(process_->get(), SIGCONT);
    ::_exit(0);
  }
  if (child_ < 0 || !send_signal(process_->get(), SIGSTOP)) {
    const std::string reason = std::strerror(errno);
    end_child();
    throw std::runtime_error{"cannot suspend " + program.label + ": " + reason};
  }
}

Suspension::~Suspension() {
  send_signal(process_->get(), SIGCONT);
  end_child();
}

void Suspension::end_child() const noexcept {
  if (child_ <= 0) return;
  ::kill(child_, SIGKILL);
  ::waitpid(child_, nullptr, 0);
}

void kill_and_restart(const Program& program) {
  const ProcessDescriptor process{program};
  std::optional<Command> command;
  std::vector<ProcessDescriptor> children;  // the gateway and the drivers of an HRTC, which end after it
  if (program.restart == Restart::kChaos) {
    command.emplace(program.pid);
    for (const pid_t child : children_of(program.pid)) children.emplace_back(child);
  }
  if (!send_signal(process.get(), SIGKILL))
    throw std::runtime_error{"cannot kill " + program.label + ": " + std::strerror(errno)};
  // The name, the ports and the devices of the killed program must be free before its successor starts.
  const bool has_ended = process.wait_for_end(kMaxEnd);
  for (const ProcessDescriptor& child : children) (void)child.wait_for_end(kMaxEnd);
  if (!has_ended) throw NotRestarted{program.label + " was killed, but has not ended"};
  if (command) command->start();
}

}  // namespace tactus::chaos
