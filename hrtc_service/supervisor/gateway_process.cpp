#include "hrtc_service/supervisor/gateway_process.hpp"

#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

namespace tactus::hrtc_service {
namespace {

constexpr int kLink = 3;  // descriptor of the shared block in the child, the first one after the standard ones

}  // namespace

std::filesystem::path gateway_program() {
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  const std::filesystem::path installed = folder.parent_path() / "libexec/tactus/tactus-gateway";
  return std::filesystem::exists(installed) ? installed : folder / "tactus-gateway";
}

GatewayProcess::GatewayProcess(const std::vector<std::string>& arguments, int link)
    : command_{gateway_program().string()}, link_{link} {
  command_.insert(command_.end(), arguments.begin(), arguments.end());
  command_.insert(command_.end(), {"--link", std::to_string(kLink)});
}

GatewayProcess::~GatewayProcess() {
  signal(SIGKILL);
  while (child_ != 0) (void)wait(std::chrono::seconds{1});
}

void GatewayProcess::start() {
  std::vector<char*> arguments;
  for (std::string& argument : command_) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, link_, kLink);
  posix_spawn_file_actions_addclosefrom_np(&actions, kLink + 1);
  // These signals are for the servo, and would end the child before it can ignore them.
  sigset_t blocked;
  sigemptyset(&blocked);
  for (const int number : {SIGINT, SIGUSR1, SIGUSR2}) sigaddset(&blocked, number);
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

std::optional<int> GatewayProcess::wait(std::chrono::milliseconds limit) {
  pollfd end{process_fd_, POLLIN, 0};  // without a descriptor, poll() only waits
  (void)poll(&end, 1, static_cast<int>(limit.count()));
  int status = 0;
  if (waitpid(child_, &status, WNOHANG) != child_) return std::nullopt;
  child_ = 0;
  if (process_fd_ >= 0) close(std::exchange(process_fd_, -1));
  return status;
}

void GatewayProcess::signal(int number) const noexcept {
  if (child_ > 0) kill(child_, number);
}

}  // namespace tactus::hrtc_service
