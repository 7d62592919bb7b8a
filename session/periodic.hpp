/// Periods of what a program publishes or does again and again. No clock: times come as arguments, ns.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace tactus::session {

/// True once in every period.
class Every {
 public:
  explicit Every(std::int64_t period_ns) : period_ns_{period_ns} {}
  [[nodiscard]] bool due(std::int64_t now_ns) {
    if (now_ns < next_ns_) return false;
    next_ns_ = now_ns + period_ns_;
    return true;
  }
  /// The time until it is due; 0 when it is.
  [[nodiscard]] std::chrono::microseconds left(std::int64_t now_ns) const {
    return std::chrono::microseconds{now_ns < next_ns_ ? (next_ns_ - now_ns + 999) / 1000 : 0};
  }
  void at_once() { next_ns_ = 0; }
  /// Due within this time, and only once in it however often this is called.
  void hasten(std::int64_t now_ns, std::int64_t within_ns) { next_ns_ = std::min(next_ns_, now_ns + within_ns); }
  void set_period(std::int64_t period_ns) { period_ns_ = period_ns; }

 private:
  std::int64_t period_ns_;
  std::int64_t next_ns_ = 0;
};

/// When to publish the next roster entry.
class Heartbeat : public Every {
 public:
  using Every::Every;
  [[nodiscard]] bool due(std::int64_t now_ns) {
    if (!Every::due(now_ns)) return false;
    if (insisting_ > 0 && --insisting_ > 0) hasten(now_ns, kInsistNs);
    return true;
  }
  /// For a participant that was just found: now and three times more, as it may not have found this program yet.
  void insist() {
    insisting_ = kInsistBeats;
    at_once();
  }

 private:
  static constexpr std::int64_t kInsistNs = 20'000'000;
  static constexpr int kInsistBeats = 4;
  int insisting_ = 0;
};

}  // namespace tactus::session
