/// A periodic timer, and one for roster entries. No clock: times are arguments, ns.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace tactus::session {

/// A periodic timer. The first call of `due` in each period returns true.
class PeriodicTimer {
 public:
  explicit PeriodicTimer(std::int64_t period_ns) : period_ns_{period_ns} {}
  [[nodiscard]] bool due(std::int64_t now_ns) {
    if (now_ns < next_ns_) return false;
    next_ns_ = now_ns + period_ns_;
    return true;
  }
  /// Time until the timer is due; 0: it is due.
  [[nodiscard]] std::chrono::microseconds remaining(std::int64_t now_ns) const {
    return std::chrono::microseconds{now_ns < next_ns_ ? (next_ns_ - now_ns + 999) / 1000 : 0};
  }
  /// Time at which the timer is due.
  [[nodiscard]] std::int64_t next_ns() const noexcept { return next_ns_; }
  /// Makes the timer due now.
  void make_due() { next_ns_ = 0; }
  /// Makes the timer due within `within_ns`. With repeated calls it is due at most once in each `within_ns`.
  void make_due_within(std::int64_t now_ns, std::int64_t within_ns) {
    next_ns_ = std::min(next_ns_, now_ns + within_ns);
  }
  void set_period(std::int64_t period_ns) { period_ns_ = period_ns; }

 private:
  std::int64_t period_ns_;
  std::int64_t next_ns_ = 0;
};

/// The timer for the roster entries of this program.
class Heartbeat : public PeriodicTimer {
 public:
  using PeriodicTimer::PeriodicTimer;
  [[nodiscard]] bool due(std::int64_t now_ns) {
    if (!PeriodicTimer::due(now_ns)) return false;
    if (repeats_left_ > 0 && --repeats_left_ > 0) make_due_within(now_ns, kRepeatNs);
    return true;
  }
  /// Makes four entries due, the first at once and the others 20 ms apart, because a participant that was just
  /// discovered may not have matched our writer yet.
  void repeat_soon() {
    repeats_left_ = kRepeats;
    make_due();
  }

 private:
  static constexpr std::int64_t kRepeatNs = 20'000'000;
  static constexpr int kRepeats = 4;
  int repeats_left_ = 0;
};

}  // namespace tactus::session
