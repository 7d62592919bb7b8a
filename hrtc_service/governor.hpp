/// How much refinement a cycle may do: from the measured cost of a unit of work, the measured cost of all else and
/// the deadline that the application set.
///
///   deadline = expected + surprise + units x cost of a unit
///
/// `expected` is what the rest of the cycle lately cost, `surprise` a high quantile of how far a cycle has cost more
/// than was foreseen, dear units included. So whatever share of cycles may miss the deadline is asked for as such, and
/// nothing but the floor (kFloor) is tuned. Where all else leaves less than the floor, cycles do miss the deadline.
///
/// Realtime. Source: Liu, Georganas, Roth, 3DIM 2005, section 5 (time-critical refinement); the quantile by stochastic
/// approximation (Robbins, Monro 1951), in the logarithm.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "spm/forest.hpp"

namespace tactus::hrtc_service {

class Governor {
 public:
  /// `deadline_ns`: the cycle's own work shall take no longer. `misses`: share of the cycles that may.
  explicit Governor(std::int64_t deadline_ns, double misses = 0.0005) noexcept
      : deadline_{static_cast<double>(deadline_ns)},
        fall_{std::exp(-kStep * misses)},
        rise_{std::exp(kStep * (1 - misses))},
        expected_ns_{deadline_ / 4},
        surprise_ns_{deadline_ / 4} {}

  /// For the next cycle.
  [[nodiscard]] spm::Budget budget() const noexcept {
    const double left = std::max(deadline_ - expected_ns_ - surprise_ns_, kFloor * deadline_);
    return {static_cast<std::uint32_t>(std::clamp(left / unit_ns(), kOneRecord, kMostUnits))};
  }

  /// What the cycle did and took: units of Budget spent, ns of refining and refitting, ns of its whole own work.
  void observe(std::uint32_t units, double refining_ns, double own_ns) noexcept {
    const double other = own_ns - units * unit_ns();
    surprise_ns_ *= other > expected_ns_ + surprise_ns_ ? rise_ : fall_;
    surprise_ns_ = std::clamp(surprise_ns_, kLeastShare * deadline_, deadline_);
    expected_ns_ += kRecent * (other - expected_ns_);
    // Slope of cost over units; what a cycle costs without any is not part of it.
    const double of_units = units - mean_units_, of_cost = refining_ns - mean_cost_;
    mean_units_ += kMemory * of_units;
    mean_cost_ += kMemory * of_cost;
    both_ += kMemory * (of_units * of_cost - both_);
    square_ += kMemory * (of_units * of_units - square_);
  }

  [[nodiscard]] double unit_ns() const noexcept {
    // Until cycles differ by more than some records' worth of units, a guess stands in.
    constexpr double kGuess = 10, kWeight = 100.0 * 100.0;
    return std::max((both_ + kGuess * kWeight) / (square_ + kWeight), 1.0);
  }
  [[nodiscard]] double expected_ns() const noexcept { return expected_ns_; }
  [[nodiscard]] double surprise_ns() const noexcept { return surprise_ns_; }

 private:
  // How fast measurements are believed; what they converge to does not depend on these.
  static constexpr double kStep = 0.3;     // of the quantile's logarithm
  static constexpr double kRecent = 0.3;   // weight of the newest cycle
  static constexpr double kMemory = 0.01;  // the same, in the cost of a unit
  // Of the deadline. Interrupts and a hypervisor add to what a cycle is seen to cost, however little it refines; a tip
  // that moves would outrun refinement that gave way to them.
  static constexpr double kFloor = 0.18;
  static constexpr double kLeastShare = 0.05;  // least surprise
  static constexpr double kOneRecord = spm::Budget::kVisit + spm::Budget::kChange;
  static constexpr double kMostUnits = 1 << 20;
  double deadline_, fall_, rise_;
  double expected_ns_, surprise_ns_;
  double mean_units_ = 0, mean_cost_ = 0, both_ = 0, square_ = 0;
};

}  // namespace tactus::hrtc_service
