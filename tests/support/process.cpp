#include "tests/support/process.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <system_error>

namespace tactus::e2e {

Process::Process(std::vector<std::string> command) {
  std::vector<char*> argv;
  for (std::string& argument : command) argv.push_back(argument.data());
  argv.push_back(nullptr);
  std::array<int, 2> pipe{};
  if (::pipe2(pipe.data(), O_CLOEXEC) != 0) throw std::system_error{errno, std::generic_category(), "pipe"};
  const pid_t parent = ::getpid();
  pid_ = ::fork();
  if (pid_ < 0) {
    const int error = errno;
    for (const int end : pipe) ::close(end);
    throw std::system_error{error, std::generic_category(), "fork"};
  }
  if (pid_ == 0) {  // other threads may hold locks: only async-signal-safe calls until exec
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(127);
    ::dup2(::open("/dev/null", O_RDONLY), STDIN_FILENO);
    ::dup2(pipe[1], STDOUT_FILENO);
    ::dup2(pipe[1], STDERR_FILENO);
    ::close_range(3, ~0u, 0);  // an inherited socket of the test would keep its port open
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  ::setpgid(pid_, pid_);  // parent and child both set the group, so the group exists no matter which of them runs first
  ::close(pipe[1]);
  reader_ = std::thread{[this, read_end = pipe[0]] { read_until_end(read_end); }};
}

Process::~Process() {
  ::kill(-pid_, SIGKILL);  // any process of the group would hold the pipe open
  reader_.join();
  ::waitpid(pid_, nullptr, 0);
}

void Process::read_until_end(int pipe) {
  std::array<char, 4096> block;
  for (ssize_t count; (count = ::read(pipe, block.data(), block.size())) != 0;) {
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) break;
    const std::lock_guard lock{mutex_};
    output_.append(block.data(), static_cast<std::size_t>(count));
    changed_.notify_all();
  }
  ::close(pipe);
  siginfo_t info{};
  // WNOWAIT: the id stays that of this program until the destructor, so that no signal reaches another process.
  while (::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOWAIT) != 0 && errno == EINTR) {
  }
  const std::lock_guard lock{mutex_};
  status_ = info.si_code == CLD_EXITED ? info.si_status : 128 + info.si_status;
  changed_.notify_all();
}

std::string Process::output() const {
  const std::lock_guard lock{mutex_};
  return output_;
}

bool Process::wait_for_line(const std::string& pattern, std::chrono::milliseconds limit) const {
  const std::regex wanted{pattern};
  std::size_t searched = 0;
  const auto found = [&] {
    for (std::size_t end; (end = output_.find('\n', searched)) != std::string::npos; searched = end + 1) {
      if (std::regex_search(output_.substr(searched, end - searched), wanted)) return true;
    }
    return false;
  };
  std::unique_lock lock{mutex_};
  bool matched = false;
  changed_.wait_for(lock, limit, [&] { return (matched = found()) || status_; });
  return matched;
}

void Process::signal(int number) {
  const std::lock_guard lock{mutex_};
  if (!status_) ::kill(pid_, number);
}

void Process::signal_all(int number) {
  const std::lock_guard lock{mutex_};
  if (!status_) ::kill(-pid_, number);
}

std::optional<int> Process::wait(std::chrono::milliseconds limit) {
  std::unique_lock lock{mutex_};
  changed_.wait_for(lock, limit, [this] { return status_.has_value(); });
  return status_;
}

bool Process::running() const {
  const std::lock_guard lock{mutex_};
  return !status_;
}

std::vector<pid_t> Process::pids() const {
  std::vector<pid_t> all{pid_};
  const std::string number = std::to_string(pid_);
  std::ifstream children{"/proc/" + number + "/task/" + number + "/children"};
  for (pid_t child = 0; children >> child;) all.push_back(child);
  return all;
}

pid_t Process::child(const std::string& name) const {
  for (const pid_t pid : pids()) {
    std::string found;
    std::getline(std::ifstream{"/proc/" + std::to_string(pid) + "/comm"} >> std::ws, found);
    if (found == name && pid != pid_) return pid;
  }
  return 0;
}

bool Process::left_nothing_running() const {
  for (const auto& entry : std::filesystem::directory_iterator{"/proc"}) {
    std::ifstream file{entry.path() / "stat"};
    std::string stat;
    if (!std::getline(file, stat)) continue;                      // no process, or it has ended
    std::istringstream fields{stat.substr(stat.rfind(')') + 1)};  // the name before them may contain anything
    char state = 0;
    pid_t parent = 0, group = 0;
    fields >> state >> parent >> group;
    if (group == pid_ && state != 'Z' && state != 'X') return false;
  }
  return true;
}

}  // namespace tactus::e2e
