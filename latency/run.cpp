#include "latency/run.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <exception>
#include <filesystem>
#include <optional>
#include <thread>

#include "netem/pair.hpp"

namespace tactus::latency {
namespace {

/// A child process, ended on destruction; first by SIGINT, so that it removes its shared memory.
class Child {
 public:
  explicit Child(pid_t pid) noexcept : pid_{pid} {}
  ~Child() {
    using namespace std::chrono_literals;
    ::kill(pid_, SIGINT);
    for (int i = 0; i < 150; ++i, std::this_thread::sleep_for(10ms))  // waitpid has no timeout
      if (::waitpid(pid_, nullptr, WNOHANG) != 0) return;
    ::kill(-pid_, SIGKILL);
    while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

 private:
  pid_t pid_;
};

std::string path_of(const std::string& program) {
  if (program.find('/') != std::string::npos) return program;
  return (std::filesystem::read_symlink("/proc/self/exe").parent_path() / program).string();
}

}  // namespace

namespace {

/// Runs `work` in a thread of its own, so that its real-time priority and namespace end with it.
template <class Work>
void in_own_thread(Work&& work) {
  std::exception_ptr trouble;
  std::thread{[&] {
    try {
      work();
    } catch (...) {
      trouble = std::current_exception();
    }
  }}.join();
  if (trouble != nullptr) std::rethrow_exception(trouble);
}

}  // namespace

Result run_against(const Cell& cell, Channel& channel, const SideSettings& side, const std::atomic<bool>& stop) {
  Stamps stamps;
  in_own_thread([&] { stamps = measure(cell, channel, side, stop); });
  return evaluate(stamps);
}

Result run_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop) {
  return evaluate(stamp_here(cell, settings, stop, {}));
}

Stamps stamp_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop, const Plan& plan) {
  std::optional<netem::LinkedPair> pair;
  std::string note;
  if (cell.link != "none") {
    netem::LinkSettings link = netem::parse_link(cell.link);
    link.seed = settings.link_seed;
    pair.emplace(link);
    if (!pair->realtime()) note = "relay: no real-time priority, delays are less exact";
  }
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0) throw LatencyError("no socket pair");
  ::fcntl(ends[0], F_SETFD, FD_CLOEXEC);
  Channel channel{ends[0], stop};
  std::vector<std::string> command{path_of(settings.echoer),
                                   "serve",
                                   "--control",
                                   std::to_string(ends[1]),
                                   "--qos",
                                   settings.side.qos.string(),
                                   "--priority",
                                   std::to_string(settings.side.priority)};
  for (const std::string& peer : settings.side.discovery.peers) command.insert(command.end(), {"--peer", peer});
  for (const std::string& server : settings.side.discovery.servers)
    command.insert(command.end(), {"--discovery-server", server});
  const Child echoer{pair ? pair->start(netem::Side::kB, command) : netem::start_program(command)};
  ::close(ends[1]);

  SideSettings side = settings.side;
  Stamps stamps;
  in_own_thread([&] {
    if (pair) {
      pair->enter(netem::Side::kA);
      side.echo_address = netem::LinkedPair::address(netem::Side::kB);
    }
    stamps = measure(cell, channel, side, stop, plan);
  });
  if (!note.empty()) stamps.notes.push_back(note);
  return stamps;
}

}  // namespace tactus::latency
