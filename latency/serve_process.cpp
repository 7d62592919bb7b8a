#include "latency/serve_process.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <thread>

#include "latency/test_case.hpp"

namespace tactus::latency {
namespace {

std::string path_of(const std::string& program) {
  if (program.find('/') != std::string::npos) return program;
  return (std::filesystem::read_symlink("/proc/self/exe").parent_path() / program).string();
}

/// Returns two connected sockets: first ours, second the socket that the process inherits.
std::pair<int, int> socket_pair() {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0) throw LatencyError("no socket pair");
  ::fcntl(ends[0], F_SETFD, FD_CLOEXEC);
  return {ends[0], ends[1]};
}

}  // namespace

ServeProcess::ServeProcess(const std::string& program, const std::vector<std::string>& options,
                           const std::atomic<bool>& cancelled, const Start& start)
    : ServeProcess{program, options, cancelled, start, socket_pair()} {}

ServeProcess::ServeProcess(const std::string& program, const std::vector<std::string>& options,
                           const std::atomic<bool>& cancelled, const Start& start, std::pair<int, int> ends)
    : control_{ends.first, cancelled} {
  std::vector<std::string> command{path_of(program), "serve", "--control", std::to_string(ends.second)};
  command.insert(command.end(), options.begin(), options.end());
  try {
    pid_ = start(std::move(command));
  } catch (...) {
    ::close(ends.second);
    throw;
  }
  ::close(ends.second);
}

ServeProcess::~ServeProcess() {
  using namespace std::chrono_literals;
  ::kill(pid_, SIGINT);
  for (int i = 0; i < 150; ++i, std::this_thread::sleep_for(10ms))  // waitpid has no timeout
    if (::waitpid(pid_, nullptr, WNOHANG) != 0) return;
  ::kill(-pid_, SIGKILL);
  while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

}  // namespace tactus::latency
