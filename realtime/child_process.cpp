#include "realtime/child_process.hpp"

#include <linux/landlock.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>

namespace tactus::realtime {
namespace {

/// Signals for the parent. The terminal sends SIGINT to the child too, and operators send the others to programs.
sigset_t signals_of_the_parent() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int number : {SIGINT, SIGUSR1, SIGUSR2}) sigaddset(&signals, number);
  return signals;
}

/// Ends this process 5 s after its parent, if it hangs and has not ended by itself. Polls, because the signal of the
/// parent's end only sets a flag, which a process that hangs does not read.
void end_after(pid_t parent) {
  std::thread{[parent] {
    while (getppid() == parent) std::this_thread::sleep_for(std::chrono::seconds{1});
    std::this_thread::sleep_for(std::chrono::seconds{5});
    _exit(1);
  }}.detach();
}

}  // namespace

std::string helper_program(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  for (const char* near : {"../libexec/tactus", "../bin"})
    if (std::filesystem::path path = folder / near / name; exists(path)) return path.lexically_normal();
  return folder / name;
}

std::string text_of_end(int wait_status) {
  if (WIFEXITED(wait_status)) return WEXITSTATUS(wait_status) == 0 ? "has ended" : "has failed";
  const char* name = sigabbrev_np(WTERMSIG(wait_status));
  return "was killed by " +
         (name == nullptr ? "signal " + std::to_string(WTERMSIG(wait_status)) : std::string{"SIG"} + name);
}

void follow_parent(pid_t parent) {
  const sigset_t blocked = signals_of_the_parent();
  for (const int number : {SIGINT, SIGUSR1, SIGUSR2}) ::signal(number, SIG_IGN);
  sigprocmask(SIG_UNBLOCK, &blocked, nullptr);
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) throw std::runtime_error("the program that has started this one has ended");
  end_after(parent);
}

bool forbid_debugging_others() noexcept {
  // A process cannot debug processes outside its Landlock domain. The rules of a domain must forbid something more, so
  // these forbid to make block devices, and signals to others where the kernel (6.12) can.
  struct {
    std::uint64_t files = LANDLOCK_ACCESS_FS_MAKE_BLOCK, network = 0, scope = 0;
  } rules;  // as landlock_ruleset_attr of Linux 6.12, which older headers lack
  constexpr std::uint64_t kScopeSignal = 1u << 1;
  const long version = syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  if (version >= 6) rules.scope = kScopeSignal;
  const int descriptor = static_cast<int>(
      syscall(SYS_landlock_create_ruleset, &rules, version >= 6 ? sizeof rules : sizeof rules.files, 0));
  if (descriptor < 0) return false;
  const bool is_restricted =
      prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && syscall(SYS_landlock_restrict_self, descriptor, 0) == 0;
  close(descriptor);
  return is_restricted;
}

ChildProcess::ChildProcess(std::vector<std::string> command, int memory)
    : command_{std::move(command)}, memory_{memory} {}

ChildProcess::~ChildProcess() {
  signal(SIGKILL);
  while (child_ != 0) (void)wait(std::chrono::seconds{1});
}

void ChildProcess::start() {
  ::signal(SIGCHLD, SIG_DFL);  // a process that ignores it could not wait for its child
  std::vector<char*> arguments;
  for (std::string& argument : command_) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, memory_, kSharedMemory);
  posix_spawn_file_actions_addclosefrom_np(&actions, kSharedMemory + 1);
  // They would end the child before it can ignore them.
  const sigset_t blocked = signals_of_the_parent();
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setsigmask(&attributes, &blocked);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
  pid_t child = 0;
  const int error = posix_spawn(&child, command_[0].c_str(), &actions, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw std::system_error{error, std::generic_category(), command_[0]};
  child_ = child;
  process_fd_ = static_cast<int>(syscall(SYS_pidfd_open, child, 0));
}

std::optional<int> ChildProcess::wait(std::chrono::milliseconds limit) {
  if (child_ == 0) return std::nullopt;
  pollfd end{process_fd_, POLLIN, 0};  // without a descriptor, poll() only waits
  (void)poll(&end, 1, static_cast<int>(limit.count()));
  int status = 0;
  if (waitpid(child_, &status, WNOHANG) != child_) return std::nullopt;
  child_ = 0;
  if (process_fd_ >= 0) close(std::exchange(process_fd_, -1));
  return status;
}

void ChildProcess::signal(int number) const noexcept {
  if (child_ > 0) kill(child_, number);
}

}  // namespace tactus::realtime
