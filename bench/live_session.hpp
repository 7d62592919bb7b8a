/// A session of real programs in two namespaces, with an observer beside them: what benchmarks of faults kill, cut off
/// and look at.
///
/// Hosts run in namespace a, everything else in b, the observer included. To be made and used by one thread, which
/// moves into namespace b; what it starts dies with it. Needs root.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "netem/pair.hpp"
#include "tests/support/process.hpp"
#include "wire/endpoints.hpp"
#include "wire/process.hpp"

namespace tactus::bench {

/// What the observer has seen since it was made, but for `states`.
struct SeenSession {
  std::map<std::uint64_t, session::RosterEntry> roster;
  std::map<std::uint64_t, session::Metrics> metrics;  ///< newest of each
  std::uint64_t serving_host = 0;                     ///< that the newest demand names, of whatever object
  std::int64_t serving_since_ns = 0;                  ///< when the first demand that names it came
  struct State {
    std::uint64_t user;
    std::uint32_t sequence;
    std::uint32_t status;
    std::int64_t time_ns;  ///< of the cycle, session time
    std::array<double, 3> force;
  };
  std::vector<State> states;  ///< probe states since the last forget_states

  /// -1 when it is not known.
  [[nodiscard]] double figure(const std::string& participant, const std::string& name) const;
};

class LiveSession {
 public:
  using Process = e2e::Process;
  /// `link` as parse_link has it.
  explicit LiveSession(const std::string& link);
  ~LiveSession();

  /// A program of ours, by its name without "tactus-", in this session.
  [[nodiscard]] std::unique_ptr<Process> start(netem::Side side, const std::string& name,
                                               std::vector<std::string> arguments);
  [[nodiscard]] wire::SessionAddress address(const std::string& participant) const;
  [[nodiscard]] netem::LinkedPair& pair() noexcept { return pair_; }

  [[nodiscard]] SeenSession seen() const;
  void forget_states();
  /// Throws std::runtime_error with `what` when the condition does not come true, std::runtime_error too when asked to
  /// stop.
  void until(const char* what, const std::function<bool(const SeenSession&)>& condition,
             std::chrono::milliseconds limit = std::chrono::seconds{20});

 private:
  struct Impl;
  netem::LinkedPair pair_;
  std::string session_;
  std::unique_ptr<Impl> impl_;
};

/// Runs `work` in a thread made for it, which may move into a namespace, and throws what that throws.
void in_own_thread(const std::function<void()>& work);

/// Programs are beside this one.
[[nodiscard]] std::string program_path(const std::string& name);

/// Waits for a line with `text` beyond `from` bytes of what the process has printed; when it was seen, ns, or 0.
[[nodiscard]] std::int64_t wait_for_text(const e2e::Process& process, std::size_t from, const std::string& text,
                                         std::chrono::milliseconds limit);
/// Sleeps, and throws std::runtime_error when asked to stop.
void pause(std::chrono::milliseconds time);

}  // namespace tactus::bench
