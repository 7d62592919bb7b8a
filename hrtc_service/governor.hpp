/// Decides how long a cycle may refine: until the application's deadline, minus the time of the work that follows.
///
///   deadline:  |--- touch ---|- refine, in portions -|- refit -|- surprise -|
///                                                    ^ last portion begins while this is not past the deadline
///
/// Forces come first, so their cost is known when refinement begins. The rest is predicted: refitting, from its
/// measured cost per unit of Budget, and `surprise`, the amount by which a cycle exceeds the prediction at the start of
/// its last portion. The governor measures two quantiles of it, which a tenth and a hundredth of the cycles exceed, and
/// extrapolates to the requested, rarer quantile on an exponential tail. It does not measure that one, because some
/// cycles in a hundred are interrupted for longer than they compute, and less refinement would not prevent that.
/// Only the floor (kFloor) is tuned. Where forces leave less time than the floor, cycles miss the deadline.
///
/// Realtime. Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (frame budget); quantiles by stochastic
/// approximation (Robbins, Monro 1951).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace tactus::hrtc_service {

/// The time at which refinement stops, whatever its Budget: ns since the start of the cycle.
struct RefineLimit {
  double until = std::numeric_limits<double>::infinity();
  double at_least = 0;    ///< time that refinement may always take
  double refit_unit = 0;  ///< cost of refitting for each refined unit

  /// The predicted end of the cycle if no further portion begins.
  [[nodiscard]] double end(double now, std::uint32_t units) const noexcept { return now + units * refit_unit; }
  /// `began`: start of the first portion, which is always permitted.
  [[nodiscard]] bool allows(double began, double now, std::uint32_t units) const noexcept {
    return end(now, units) < std::max(until, began + at_least);
  }
};

class Governor {
 public:
  /// `deadline_ns`: limit of the cycle's own work. `misses`: share of the cycles that may exceed it.
  explicit Governor(std::int64_t deadline_ns, double misses = 0.0005) noexcept
      : deadline_{static_cast<double>(deadline_ns)},
        further_{std::log(kOften / misses) / std::log(kOften / kSeldom)},
        often_{deadline_ / 10, kOften},
        seldom_{deadline_ / 5, kSeldom} {}

  /// The limit for the next cycle.
  [[nodiscard]] RefineLimit limit() const noexcept {
    return {deadline_ - surprise_ns(), kFloor * deadline_, refit_unit_ns()};
  }

  /// Reports a cycle: refined units, ns of refitting, ns of the whole cycle, and the prediction of that at the start of
  /// its last portion. An interruption before that start is in both times, so it changes nothing.
  void observe(std::uint32_t units, double refit_ns, double taken_ns, double foreseen_ns) noexcept {
    const double min = kMinShare * deadline_;
    often_.see(taken_ns - foreseen_ns, min, deadline_);
    seldom_.see(taken_ns - foreseen_ns, min, deadline_);
    units_ += kMemory * (units - units_);
    refit_ns_ += kMemory * (refit_ns - refit_ns_);
  }

  [[nodiscard]] double refit_unit_ns() const noexcept {
    constexpr double kGuess = 4, kWeight = 10;  // units; until the first measurements
    return (refit_ns_ + kGuess * kWeight) / (units_ + kWeight);
  }
  [[nodiscard]] double surprise_ns() const noexcept {
    const double apart = std::max(seldom_.value - often_.value, 0.0);
    return std::min(often_.value + further_ * apart, deadline_);
  }

 private:
  // Speed of convergence; the limits do not depend on it.
  static constexpr double kStep = 0.1;     // of a quantile's logarithm
  static constexpr double kMemory = 0.01;  // weight of the newest cycle in the cost of refitting
  static constexpr double kOften = 0.1, kSeldom = 0.01;
  // Of the deadline. Forces may take all of it; without a floor a moving tip would outrun refinement.
  static constexpr double kFloor = 0.18;
  static constexpr double kMinShare = 0.01;  // smallest quantile

  /// The value that a given share of the cycles exceeds.
  struct Quantile {
    Quantile(double start, double share) noexcept
        : value{start}, rise{std::exp(kStep * (1 - share))}, fall{std::exp(-kStep * share)} {}
    void see(double sample, double min, double max) noexcept {
      value = std::clamp(value * (sample > value ? rise : fall), min, max);
    }
    double value, rise, fall;
  };

  double deadline_;
  double further_;  // position on the tail, in units of the distance between the two quantiles
  Quantile often_, seldom_;
  double units_ = 0, refit_ns_ = 0;  // of a cycle, smoothed
};

}  // namespace tactus::hrtc_service
