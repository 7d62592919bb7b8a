#include "tools/chaos/programs.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>
#include <stdexcept>
#include <system_error>

namespace tactus::chaos {
namespace {

namespace fs = std::filesystem;

constexpr char kDefaultSession[] = "tactus", kDefaultDomain[] = "20";
constexpr int kMaxEndMs = 5000;  // time in which the kernel ends a killed process

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

/// Returns the number of a field of /proc/PID/stat after the name of the program, from 1.
std::uint64_t stat_field(pid_t pid, int field) {
  const std::string stat = read_file(folder_of(pid) / "stat");
  std::istringstream fields{stat.substr(std::min(stat.size(), stat.rfind(')') + 1))};
  std::string text;
  for (int i = 0; i < field; ++i) fields >> text;
  return std::strtoull(text.c_str(), nullptr, 10);
}
std::uint64_t start_of(pid_t pid) { return stat_field(pid, 20); }

/// Whether this process sees the same files and processes as the other. False for one in a container or chroot.
bool shares_namespaces(pid_t pid) {
  for (const char* name : {"ns/mnt", "ns/pid", "root"}) {
    struct stat theirs {
    }, ours{};
    if (::stat((folder_of(pid) / name).c_str(), &theirs) != 0 ||
        ::stat((fs::path{"/proc/self"} / name).c_str(), &ours) != 0)
      return false;
    if (theirs.st_ino != ours.st_ino) return false;
  }
  return true;
}

std::runtime_error failure(const Program& program, const char* what) {
  return std::runtime_error{std::string{what} + " " + program.label + " (process " + std::to_string(program.pid) +
                            "): " + std::strerror(errno)};
}

/// Sends a signal to the process of a descriptor, as pidfd_send_signal() of later C libraries. Async-signal-safe.
bool send_signal(int process, int number) noexcept {
  return ::syscall(SYS_pidfd_send_signal, process, number, nullptr, 0) == 0;
}

/// Opens a descriptor of the process, which names it even after its id is used again.
int open_process(const Program& program) {
  const auto process = static_cast<int>(::syscall(SYS_pidfd_open, program.pid, 0));
  if (process < 0) throw failure(program, "cannot find");
  if (start_of(program.pid) != program.started) {
    ::close(process);
    errno = ESRCH;
    throw failure(program, "cannot find");
  }
  return process;
}

/// All that a process needs to start again.
struct Command {
  std::string program, folder;
  std::vector<std::string> arguments, environment;
  int network = -1;                    // descriptor of its network namespace
  std::array<int, 2> outputs{-1, -1};  // of standard output and error

  explicit Command(pid_t pid)
      : program{fs::read_symlink(folder_of(pid) / "exe")},
        folder{fs::read_symlink(folder_of(pid) / "cwd")},
        arguments{split_at_zeros(read_file(folder_of(pid) / "cmdline"))},
        environment{split_at_zeros(read_file(folder_of(pid) / "environ"))},
        network{::open((folder_of(pid) / "ns/net").c_str(), O_RDONLY | O_CLOEXEC)} {
    for (std::size_t i = 0; i < outputs.size(); ++i)
      outputs[i] = ::open((folder_of(pid) / "fd" / std::to_string(i + 1)).c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
  }
  ~Command() {
    for (const int descriptor : {network, outputs[0], outputs[1]})
      if (descriptor >= 0) ::close(descriptor);
  }
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  void start() {
    std::vector<char*> argv, envp;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    for (std::string& variable : environment) envp.push_back(variable.data());
    argv.push_back(nullptr);
    envp.push_back(nullptr);
    const pid_t child = ::fork();
    if (child < 0) throw std::system_error{errno, std::generic_category(), "fork"};
    if (child == 0) {  // other threads may hold locks: only async-signal-safe calls until exec
      // A second fork: the program is then no child of this one, which need not wait for it.
      if (::fork() != 0) ::_exit(0);
      ::setsid();
      struct stat ours {
      }, theirs{};
      const bool is_elsewhere =
          ::fstat(network, &theirs) == 0 && ::stat("/proc/self/ns/net", &ours) == 0 && ours.st_ino != theirs.st_ino;
      if ((is_elsewhere && ::setns(network, CLONE_NEWNET) != 0) || ::chdir(folder.c_str()) != 0) ::_exit(127);
      ::dup2(::open("/dev/null", O_RDONLY), STDIN_FILENO);
      for (std::size_t i = 0; i < outputs.size(); ++i)
        ::dup2(outputs[i] >= 0 ? outputs[i] : ::open("/dev/null", O_WRONLY), static_cast<int>(i) + 1);
      ::execve(program.c_str(), argv.data(), envp.data());
      ::_exit(127);
    }
    ::waitpid(child, nullptr, 0);
  }
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
  program.started = start_of(pid);
  const std::string name = option(arguments, "--name", "");
  program.label = file.substr(std::strlen("tactus-")) + (name.empty() ? "" : " " + name);
  program.has_driver = (file == "tactus-hrtc" || file == "tactus-gateway") && has_option(arguments, "--device");
  const bool is_service = file == "tactus-host" || file == "tactus-hrtc";
  const bool has_parent_hrtc = file == "tactus-gateway" && has_option(arguments, "--link");
  if (has_parent_hrtc)
    program.restart = Restart::kItsSupervisor;
  else if (is_service && may_start && shares_namespaces(pid))
    program.restart = Restart::kChaos;
  return program;
}

}  // namespace

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
  if (start_of(program.pid) != program.started) return std::nullopt;
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

Suspension::Suspension(const Program& program, double seconds) : process_{open_process(program)} {
  child_ = ::fork();
  if (child_ == 0) {
    ::setsid();  // Ctrl-C does not end the child, which resumes the program in any case
    const timespec time{static_cast<time_t>(seconds), static_cast<long>((seconds - std::floor(seconds)) * 1e9)};
    ::nanosleep(&time, nullptr);
    send_signal(process_, SIGCONT);
    ::_exit(0);
  }
  if (child_ < 0 || !send_signal(process_, SIGSTOP)) {
    const std::runtime_error error = failure(program, "cannot suspend");
    if (child_ > 0) {
      ::kill(child_, SIGKILL);
      ::waitpid(child_, nullptr, 0);
    }
    ::close(process_);
    throw error;
  }
}

Suspension::~Suspension() {
  send_signal(process_, SIGCONT);
  ::kill(child_, SIGKILL);
  ::waitpid(child_, nullptr, 0);
  ::close(process_);
}

void kill_and_restart(const Program& program) {
  const int process = open_process(program);
  std::optional<Command> command;
  try {
    if (program.restart == Restart::kChaos) command.emplace(program.pid);
  } catch (...) {
    ::close(process);
    throw;
  }
  const bool is_sent = send_signal(process, SIGKILL);
  pollfd ended{process, POLLIN, 0};
  // The name and the ports of the killed process must be free before its successor starts.
  const bool is_gone = is_sent && ::poll(&ended, 1, kMaxEndMs) == 1;
  const std::runtime_error error = failure(program, "cannot kill");
  ::close(process);
  if (!is_gone) throw error;
  if (command) command->start();
}

}  // namespace tactus::chaos
