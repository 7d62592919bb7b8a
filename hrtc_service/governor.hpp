/// How long a cycle may refine: until the deadline that the application set, less what refining still leaves to do.
///
///   deadline:  |--- touch ---|- refine, in portions -|- refit -|- surprise -|
///                                                    ^ last portion begins while this is not past the deadline
///
/// Forces come first, so what they cost is known when refinement begins. What is ahead is foreseen: refitting, by its
/// measured cost per unit of Budget refined, and `surprise`, by which cycles cost more than was foreseen when their
/// last portion began. Two quantiles of that are measured, exceeded by a tenth and a hundredth of the cycles, and the
/// rarer one that is asked for lies further along the same exponential tail. It is not measured itself: one cycle in
/// some hundred is interrupted for longer than it works, whatever it does, and refinement would only give way to that.
/// So nothing but the floor (kFloor) is tuned. Where forces leave less than the floor, cycles do miss the deadline.
///
/// Realtime. Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (frame budget); quantiles by stochastic
/// approximation (Robbins, Monro 1951).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace tactus::hrtc_service {

/// When refinement stops, whatever its Budget: ns, from where the cycle began.
struct RefineLimit {
  double until = std::numeric_limits<double>::infinity();
  double at_least = 0;    ///< refinement may take so long in any case
  double refit_unit = 0;  ///< what refitting costs for a unit refined

  /// When the cycle will end, as far as can be foreseen, if no further portion begins.
  [[nodiscard]] double end(double now, std::uint32_t units) const noexcept { return now + units * refit_unit; }
  /// `began`: when the first portion did, which may always.
  [[nodiscard]] bool allows(double began, double now, std::uint32_t units) const noexcept {
    return end(now, units) < std::max(until, began + at_least);
  }
};

class Governor {
 public:
  /// `deadline_ns`: the cycle's own work shall take no longer. `misses`: share of the cycles that may.
  explicit Governor(std::int64_t deadline_ns, double misses = 0.0005) noexcept
      : deadline_{static_cast<double>(deadline_ns)},
        further_{std::log(kOften / misses) / std::log(kOften / kSeldom)},
        often_{deadline_ / 10, kOften},
        seldom_{deadline_ / 5, kSeldom} {}

  /// For the next cycle.
  [[nodiscard]] RefineLimit limit() const noexcept {
    return {deadline_ - surprise_ns(), kFloor * deadline_, refit_unit_ns()};
  }

  /// What the cycle did and took: units refined, ns of refitting, ns from its beginning to its end, and what that was
  /// foreseen to be when its last portion began. An interruption before that moment is in both, so it changes nothing.
  void observe(std::uint32_t units, double refit_ns, double taken_ns, double foreseen_ns) noexcept {
    const double min = kMinShare * deadline_;
    often_.see(taken_ns - foreseen_ns, min, deadline_);
    seldom_.see(taken_ns - foreseen_ns, min, deadline_);
    units_ += kMemory * (units - units_);
    refit_ns_ += kMemory * (refit_ns - refit_ns_);
  }

  [[nodiscard]] double refit_unit_ns() const noexcept {
    constexpr double kGuess = 4, kWeight = 10;  // units; until there is something to measure
    return (refit_ns_ + kGuess * kWeight) / (units_ + kWeight);
  }
  [[nodiscard]] double surprise_ns() const noexcept {
    const double apart = std::max(seldom_.value - often_.value, 0.0);
    return std::min(often_.value + further_ * apart, deadline_);
  }

 private:
  // How fast measurements are believed; what they converge to does not depend on these.
  static constexpr double kStep = 0.1;     // of a quantile's logarithm
  static constexpr double kMemory = 0.01;  // weight of the newest cycle in the cost of refitting
  static constexpr double kOften = 0.1, kSeldom = 0.01;
  // Of the deadline. Forces may take all of it; a tip that moves would outrun refinement that gave way to them.
  static constexpr double kFloor = 0.18;
  static constexpr double kMinShare = 0.01;  // least quantile

  /// What a share of the cycles exceeds.
  struct Quantile {
    Quantile(double start, double share) noexcept
        : value{start}, rise{std::exp(kStep * (1 - share))}, fall{std::exp(-kStep * share)} {}
    void see(double sample, double min, double max) noexcept {
      value = std::clamp(value * (sample > value ? rise : fall), min, max);
    }
    double value, rise, fall;
  };

  double deadline_;
  double further_;  // how far along the tail, in distances between the two
  Quantile often_, seldom_;
  double units_ = 0, refit_ns_ = 0;  // of a cycle, lately
};

}  // namespace tactus::hrtc_service
