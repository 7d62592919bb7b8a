#include "hrtc_service/supervisor/supervisor.hpp"

#include <signal.h>
#include <sys/wait.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "hrtc_service/program/options.hpp"
#include "realtime/process.hpp"

namespace tactus::hrtc_service {
namespace {

using session::Severity;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::chrono::milliseconds kPoll{50};
constexpr std::int64_t kMaxSilenceNs = 10'000 * kMs;  // between two heartbeats
constexpr std::int64_t kMaxStartNs = 60'000 * kMs;    // until the first heartbeat, which a tool of many faces delays
constexpr std::int64_t kEndNs = 5'000 * kMs;          // max time for the end
constexpr std::int64_t kSteadyNs = 10'000 * kMs;      // after which a gateway is started again without a pause
constexpr std::int64_t kMinPauseNs = 100 * kMs, kMaxPauseNs = 1'000 * kMs;

}  // namespace

Supervisor::Supervisor(realtime::ChildProcess& gateway, ServoLink& link, const std::atomic<bool>& stop,
                       std::function<void()> end_servo, std::function<void(Severity, const std::string&)> on_event)
    : gateway_{gateway}, link_{link}, stop_{stop}, end_servo_{std::move(end_servo)}, on_event_{std::move(on_event)} {}

int Supervisor::run() {
  gateway_.start();
  for (;;) {
    const std::int64_t started_ns = realtime::monotonic_ns();
    const int wait_status = wait_for_end();
    if (const int status = status_at_end(wait_status); status != kStartAgain) {
      end_servo();
      return status;
    }
    if (realtime::monotonic_ns() - started_ns > kSteadyNs) pause_ns_ = 0;
    if (!start_again()) {
      end_servo();
      return 0;
    }
  }
}

/// Waits until the gateway has ended. If the HRTC should end, ends both. Kills a gateway that
/// hangs. Returns its status, as waitpid() does.
int Supervisor::wait_for_end() {
  std::int64_t last_ns = realtime::monotonic_ns(), silent_ns = 0, ending_ns = 0;
  std::uint64_t beats = link_.heartbeats();
  std::int64_t max_silence_ns = kMaxStartNs;
  bool is_signalled = false;
  for (;;) {
    if (stop_ && !std::exchange(is_signalled, true)) gateway_.signal(SIGTERM);
    if (is_ending()) end_servo();
    if (const std::optional<int> status = gateway_.wait(kPoll)) return *status;
    // Only the time in which this process runs counts, because both may have been suspended.
    const std::int64_t now_ns = realtime::monotonic_ns();
    const std::int64_t step_ns = std::min(now_ns - std::exchange(last_ns, now_ns), 2 * kPoll.count() * kMs);
    if (is_ending()) {
      if ((ending_ns += step_ns) > kEndNs) gateway_.signal(SIGKILL);
      continue;
    }
    if (std::exchange(beats, link_.heartbeats()) != beats) {
      silent_ns = 0;
      max_silence_ns = kMaxSilenceNs;
    }
    if ((silent_ns += step_ns) <= max_silence_ns) continue;
    on_event_(Severity::kError, "the gateway (tactus-gateway) does not respond; it is killed");
    gateway_.signal(SIGKILL);
    silent_ns = 0;
  }
}

/// Returns the exit status of the HRTC, or kStartAgain.
int Supervisor::status_at_end(int wait_status) {
  const int declared = link_.ended();
  if (WIFEXITED(wait_status) && WEXITSTATUS(wait_status) != kStartAgain) return WEXITSTATUS(wait_status);
  const std::string text = "the gateway (tactus-gateway) " + realtime::text_of_end(wait_status);
  if (is_ending()) {
    on_event_(Severity::kWarning, text + " at the end");
    return std::max(declared, 1);
  }
  const bool has_joined = link_.heartbeats() > 0;
  on_event_(Severity::kError, text + (has_joined ? "; it starts again" : " at the start"));
  return has_joined ? kStartAgain : 1;
}

/// Starts the gateway again, after a pause. Returns false if the HRTC should end instead.
bool Supervisor::start_again() {
  for (;;) {
    const std::int64_t until_ns = realtime::monotonic_ns() + pause_ns_;
    pause_ns_ = std::clamp(2 * pause_ns_, kMinPauseNs, kMaxPauseNs);
    // Waits in steps, because a signal that sets `stop_` may arrive in another thread.
    while (!stop_ && realtime::monotonic_ns() < until_ns) std::this_thread::sleep_for(kPoll);
    if (stop_) return false;
    try {
      gateway_.start();
      return true;
    } catch (const std::system_error& error) {
      on_event_(Severity::kError, std::string{"the gateway cannot be started: "} + error.what());
    }
  }
}

void Supervisor::end_servo() {
  if (!end_servo_) return;
  std::exchange(end_servo_, nullptr)();
  link_.set_servo_ended();
}

}  // namespace tactus::hrtc_service
