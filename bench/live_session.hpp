/// A session of real programs in two network namespaces, with an observer that receives the samples of the programs.
///
/// Benchmarks run hosts in namespace a and most other programs in namespace b. The observer is in namespace b, too. One
/// thread constructs and uses a LiveSession. The constructor moves this thread into namespace b, and the started
/// programs end with the thread. Needs root.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "bench/session_keys.hpp"
#include "netem/pair.hpp"
#include "realtime/process.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "wire/endpoints.hpp"

namespace tactus::bench {

/// Samples that the observer has received since it was constructed.
struct ObservedSession {
  std::map<std::uint64_t, session::RosterEntry> roster;
  std::map<std::uint64_t, session::Metrics> metrics;  ///< newest of each participant
  std::uint64_t serving_host = 0;                     ///< Demand::serving_host of the newest demand for any object
  std::int64_t serving_since_ns = 0;                  ///< arrival of the first demand with this host, monotonic
  /// The stream of a host to an HRTC. Each start of a host begins a new one.
  struct Stream {
    std::uint32_t id = 0;
    std::int64_t acknowledged_ns = 0;  ///< arrival of the first demand that acknowledges a chunk of it, monotonic
  };
  std::map<std::uint64_t, Stream> streams;  ///< the newest with an acknowledged chunk, by HRTC; for one object
  struct State {
    std::uint64_t user;
    std::uint32_t sequence;
    std::uint32_t status;
    std::int64_t time_ns;  ///< session time of the cycle
    std::array<double, 3> force;
    std::uint64_t incarnation;  ///< of the HRTC
    std::int64_t received_ns;   ///< monotonic
  };
  std::vector<State> states;  ///< probe states since forget_states() was called last

  /// Returns the newest value of a figure of a participant, or -1 if there is none.
  [[nodiscard]] double figure(const std::string& participant, const std::string& name) const;
  /// Whether one of `states` is an exact contact of the user, from an HRTC whose incarnation is larger than `since`.
  [[nodiscard]] bool touches_exactly(const std::string& user, std::uint64_t since = 0) const;
};

enum class Protection : std::uint8_t {
  kPlain,   ///< no keys
  kSecured  ///< every program has keys
};

class LiveSession {
 public:
  using Process = e2e::Process;
  /// `link` has the syntax of netem::parse_link.
  explicit LiveSession(const std::string& link, Protection protection = Protection::kPlain);
  ~LiveSession();

  /// Starts the program tactus-`name` as a participant of this session. In a secured session it gets the keys of the
  /// participant that the option --name of its arguments names, or of one with the name of the program. `launcher`: a
  /// command that executes the command that follows it; may be empty.
  [[nodiscard]] std::unique_ptr<Process> start(netem::Side side, const std::string& name,
                                               std::vector<std::string> arguments,
                                               const std::vector<std::string>& launcher = {});
  [[nodiscard]] wire::SessionAddress address(const std::string& participant) const;
  [[nodiscard]] netem::LinkedPair& pair() noexcept { return pair_; }

  [[nodiscard]] ObservedSession observed() const;
  void forget_states();
  /// Waits until `condition` holds. Throws std::runtime_error after `limit`, with `what` in its text, and at
  /// realtime::stop_signal.
  void wait_until(const char* what, const std::function<bool(const ObservedSession&)>& condition,
                  std::chrono::milliseconds limit = std::chrono::seconds{20});

 private:
  struct Impl;
  netem::LinkedPair pair_;
  std::string session_;
  test_support::TemporaryFolder folder_;
  std::unique_ptr<SessionKeys> keys_;  // null: a plain session
  std::unique_ptr<Impl> impl_;
};

/// Runs `work` in a new thread, which may move into a namespace, and rethrows its exception.
void in_own_thread(const std::function<void()>& work);

/// Returns the path of tactus-`name`, in the folder of the running benchmark, or in `bin` next to the folder of a test.
[[nodiscard]] std::string program_path(const std::string& name);

/// Runs tactus-`name` of that folder to its end. Throws std::runtime_error with its output if it fails.
void run_program(const std::string& name, std::vector<std::string> arguments);

/// Waits until `text` appears in the output of the process, after the first `from` bytes of this output. Returns the
/// time at which it appeared, monotonic ns, or 0 if it has not appeared within `limit`.
[[nodiscard]] std::int64_t wait_for_text(const e2e::Process& process, std::size_t from, const std::string& text,
                                         std::chrono::milliseconds limit);
/// Sleeps. Throws std::runtime_error at realtime::stop_signal.
void pause(std::chrono::milliseconds time);

}  // namespace tactus::bench
