#include "hrtc_service/supervisor/supervisor.hpp"

#include <signal.h>
#include <string.h>
#include <sys/wait.h>

#include <algorithm>
#include <optional>
#include <thread>
#include <utility>

#include "realtime/process.hpp"

namespace tactus::hrtc_service {
namespace {

using session::Severity;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::chrono::milliseconds kPoll{50};
constexpr std::int64_t kMaxSilenceNs = 10'000 * kMs;
constexpr std::int64_t kEndNs = 5'000 * kMs;      // max time between SIGTERM and the end
constexpr std::int64_t kSteadyNs = 10'000 * kMs;  // a gateway that has run for this time is started again at once
constexpr std::int64_t kMinPauseNs = 100 * kMs, kMaxPauseNs = 2'000 * kMs;

std::string name_of(int signal) {
  const char* name = sigabbrev_np(signal);
  return name == nullptr ? "signal " + std::to_string(signal) : std::string{"SIG"} + name;
}

}  // namespace

Supervisor::Supervisor(GatewayProcess& gateway, const ServoLink& link, const std::atomic<bool>& stop,
                       std::function<void(Severity, const std::string&)> on_event)
    : gateway_{gateway}, link_{link}, stop_{stop}, on_event_{std::move(on_event)} {}

int Supervisor::run() {
  for (;;) {
    const std::int64_t started_ns = realtime::monotonic_ns();
    gateway_.start();
    const int status = wait_for_end();
    if (WIFEXITED(status)) return WEXITSTATUS(status);
    if (realtime::monotonic_ns() - started_ns > kSteadyNs) pause_ns_ = 0;
    if (!start_again(WTERMSIG(status))) return stop_ ? 0 : 1;
  }
}

/// Waits until the gateway has ended. Ends it when `stop_` is set, and kills it if it does not end or hangs.
int Supervisor::wait_for_end() {
  std::int64_t last_ns = realtime::monotonic_ns(), silent_ns = 0, stopping_ns = 0;
  std::uint64_t beats = link_.heartbeats();
  bool has_beaten = false, is_stopping = false;
  for (;;) {
    if (stop_ && !is_stopping) {
      gateway_.signal(SIGTERM);
      is_stopping = true;
    }
    if (const std::optional<int> status = gateway_.wait(kPoll)) return *status;
    // Only the time in which this process runs counts, because both may have been suspended.
    const std::int64_t now_ns = realtime::monotonic_ns();
    const std::int64_t step_ns = std::min(now_ns - std::exchange(last_ns, now_ns), 2 * kPoll.count() * kMs);
    if (is_stopping && (stopping_ns += step_ns) > kEndNs) gateway_.signal(SIGKILL);
    const bool is_silent = std::exchange(beats, link_.heartbeats()) == beats;
    has_beaten = has_beaten || !is_silent;
    silent_ns = is_silent && has_beaten && !is_stopping ? silent_ns + step_ns : 0;
    if (silent_ns <= kMaxSilenceNs) continue;
    on_event_(Severity::kError, "the network part (tactus-gateway) does not respond; it is killed");
    gateway_.signal(SIGKILL);
    has_beaten = false;  // one message
  }
}

/// Waits before the next start, and returns true. Returns false if the HRTC should end.
bool Supervisor::start_again(int signal) {
  if (stop_) return false;
  const bool has_joined = link_.heartbeats() > 0;
  on_event_(Severity::kError, "the network part (tactus-gateway) was killed by " + name_of(signal) +
                                  (has_joined ? "; it starts again" : " before it had joined the session"));
  if (!has_joined) return false;
  const std::int64_t until_ns = realtime::monotonic_ns() + pause_ns_;
  pause_ns_ = std::clamp(2 * pause_ns_, kMinPauseNs, kMaxPauseNs);
  while (!stop_ && realtime::monotonic_ns() < until_ns) std::this_thread::sleep_for(kPoll);
  return !stop_;
}

}  // namespace tactus::hrtc_service
