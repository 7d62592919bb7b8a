/// Decides how long a cycle may refine, so that it ends before its deadline.
///
///     |--- touch ---|- refine, in portions -|- refit -|- excess -|  deadline
///                                           ^ another portion begins only if refit and excess fit
///
/// Forces come first, so their cost is known when refinement begins. The cost of refitting is predicted from its
/// measured cost for each unit of Budget. The excess is the time by which a cycle takes longer than predicted at the
/// start of its last portion.
///
/// The governor measures two quantiles of the excess: the values that a tenth and a hundredth of the cycles exceed.
/// Through both it fits an exponential tail, and extrapolates the value that only the permitted share of the cycles
/// exceeds (`missing_share`). It does not measure this rare value: some cycles in a hundred are interrupted for longer
/// than they compute, and less refinement would not prevent the interruptions. Only the floor (kFloor) is tuned. If
/// forces leave less time than the floor, cycles miss the deadline.
///
/// Realtime. Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (frame budget); quantiles by stochastic
/// approximation (Robbins, Monro 1951).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace tactus::hrtc_service {

/// The time limit of refinement in one cycle, in addition to its Budget.
struct RefineLimit {
  double max_end = std::numeric_limits<double>::infinity();  ///< max predicted end, ns since the start of the cycle
  double min_duration = 0;                                   ///< time that refinement may always take, ns
  double refit_ns_per_unit = 0;                              ///< cost of refitting for each refined unit of Budget, ns

  /// Returns the predicted end of the cycle if no further portion begins, ns.
  [[nodiscard]] double predicted_end(double now, std::uint32_t units) const noexcept {
    return now + units * refit_ns_per_unit;
  }
  /// Returns whether another portion may begin at `now`. `began`: start of the first portion, which is always
  /// permitted.
  [[nodiscard]] bool allows(double began, double now, std::uint32_t units) const noexcept {
    return predicted_end(now, units) < std::max(max_end, began + min_duration);
  }
};

class Governor {
 public:
  /// `deadline_ns`: limit of the cycle's own work. `missing_share`: share of the cycles that may exceed it.
  explicit Governor(std::int64_t deadline_ns, double missing_share = 0.0005) noexcept
      : deadline_{static_cast<double>(deadline_ns)},
        tail_factor_{std::log(kTenth / missing_share) / std::log(kTenth / kHundredth)},
        excess_of_tenth_{deadline_ / 10, kTenth},
        excess_of_hundredth_{deadline_ / 5, kHundredth} {}

  /// Returns the limit for the next cycle.
  [[nodiscard]] RefineLimit limit() const noexcept {
    return {deadline_ - excess_ns(), kFloor * deadline_, refit_ns_per_unit()};
  }

  /// Adds a cycle: its refined units of Budget, the time of refitting, the time of the whole cycle, and the prediction
  /// of that time at the start of its last portion. An interruption before that start is in both times, so it does not
  /// count as excess.
  void observe(std::uint32_t units, double refit_ns, double cycle_ns, double predicted_ns) noexcept {
    const double min = kMinExcessShare * deadline_;
    excess_of_tenth_.update(cycle_ns - predicted_ns, min, deadline_);
    excess_of_hundredth_.update(cycle_ns - predicted_ns, min, deadline_);
    units_ += kRefitWeight * (units - units_);
    refit_ns_ += kRefitWeight * (refit_ns - refit_ns_);
  }

  [[nodiscard]] double refit_ns_per_unit() const noexcept {
    constexpr double kGuess = 4, kWeight = 10;  // ns for each unit, and its weight in units, before measurements
    return (refit_ns_ + kGuess * kWeight) / (units_ + kWeight);
  }
  [[nodiscard]] double excess_ns() const noexcept {
    const double distance = std::max(excess_of_hundredth_.value - excess_of_tenth_.value, 0.0);
    return std::min(excess_of_tenth_.value + tail_factor_ * distance, deadline_);
  }

 private:
  // kStep and kRefitWeight set how fast the estimates converge, not the values to which they converge.
  static constexpr double kStep = 0.1;          // step of a quantile's logarithm
  static constexpr double kRefitWeight = 0.01;  // weight of the newest cycle in the cost of refitting
  static constexpr double kTenth = 0.1, kHundredth = 0.01;
  // Shares of the deadline. The floor is needed because forces may take the whole deadline: without refinement a fast
  // tip would reach coarse regions.
  static constexpr double kFloor = 0.18;           // min duration of refinement
  static constexpr double kMinExcessShare = 0.01;  // min value of a quantile

  /// Estimates the value that a given share of the samples exceeds.
  struct Quantile {
    Quantile(double start, double share) noexcept
        : value{start}, rise{std::exp(kStep * (1 - share))}, fall{std::exp(-kStep * share)} {}
    void update(double sample, double min, double max) noexcept {
      value = std::clamp(value * (sample > value ? rise : fall), min, max);
    }
    double value, rise, fall;
  };

  double deadline_;
  double tail_factor_;  // distance of the extrapolated quantile / distance of the measured quantiles
  Quantile excess_of_tenth_, excess_of_hundredth_;
  double units_ = 0, refit_ns_ = 0;  // of a cycle, smoothed
};

}  // namespace tactus::hrtc_service
