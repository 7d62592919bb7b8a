/// Detects that the haptic thread needs several periods of CPU time in many cycles.
///
/// Forces are stable only at the planned rate of cycles. The intake checks that a mesh is valid, but a valid mesh can
/// take too much time. Other programs can delay a cycle too, so the time on the clock does not count.
///
/// A cycle is heavy if it takes more than kPeriods of CPU time. 50 heavy cycles in a row are an overload, or more than
/// a sixth of all cycles for some time. The CPU time since the last reading, minus the clock time of the cycles in
/// between, estimates the CPU time of a cycle.
///
/// One thread. Realtime; a cycle that takes more than kPeriods on the clock makes one system call.
#pragma once

#include <cstdint>
#include <utility>

namespace tactus::hrtc_service {

class Overload {
 public:
  static constexpr std::int64_t kPeriods = 3;

  explicit Overload(std::int64_t period_ns) noexcept : max_ns_{kPeriods * period_ns} {}

  /// Counts a cycle whose work took `work_ns` on the clock. `cpu_ns()` returns the CPU time of the thread so far.
  /// Returns true when an overload begins.
  template <class CpuTime>
  [[nodiscard]] bool observe(std::int64_t work_ns, const CpuTime& cpu_ns) noexcept {
    if (work_ns <= max_ns_) {
      other_ns_ += work_ns;
      if (level_ > 0) --level_;
      return false;
    }
    const std::int64_t now_ns = cpu_ns();
    const std::int64_t own_ns = now_ns - std::exchange(read_ns_, now_ns) - std::exchange(other_ns_, 0);
    if (own_ns <= max_ns_) return false;
    level_ += kHeavy;
    if (level_ < kLimit) return false;
    level_ = 0;
    return true;
  }

 private:
  static constexpr std::uint32_t kHeavy = 5, kLimit = 50 * kHeavy;

  std::int64_t max_ns_;
  std::int64_t read_ns_ = 0;   // CPU time at the last heavy cycle
  std::int64_t other_ns_ = 0;  // work since then
  std::uint32_t level_ = 0;    // rises by kHeavy in a heavy cycle, falls by 1 in another one
};

}  // namespace tactus::hrtc_service
