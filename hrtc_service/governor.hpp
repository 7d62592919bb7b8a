/// How much refinement a cycle may do: from the measured cost of a unit of work and the deadline that the application
/// set.
///
/// Realtime. Source: Liu, Georganas, Roth, 3DIM 2005, section 5 (time-critical refinement).
#pragma once

#include <algorithm>
#include <cstdint>

#include "spm/forest.hpp"

namespace tactus::hrtc_service {

class Governor {
 public:
  /// `deadline_ns`: the cycle's own work shall take no longer.
  explicit Governor(std::int64_t deadline_ns) noexcept : deadline_{deadline_ns} {}

  /// For the next cycle.
  [[nodiscard]] spm::Budget budget() const noexcept {
    // The rest of the cycle may cost what it lately cost at its worst; what is left goes to refinement.
    const double left = static_cast<double>(deadline_) * kShare - other_ns_;
    const double units = std::max(left, 0.0) / unit_ns_;
    return {static_cast<std::uint32_t>(std::clamp(units, kLeastUnits, kMostUnits))};
  }

  /// What the cycle did and took: units of Budget spent, ns of refining and refitting, ns of all else.
  void observe(std::uint32_t units, std::uint32_t refining_ns, std::uint32_t other_ns) noexcept {
    if (units >= kMeaningful) {
      const double cost = static_cast<double>(refining_ns) / units;
      unit_ns_ += (cost > unit_ns_ ? kRise : kFall) * (cost - unit_ns_);
    }
    other_ns_ += (other_ns > other_ns_ ? kRise : kFall) * (other_ns - other_ns_);
  }

  [[nodiscard]] double unit_ns() const noexcept { return unit_ns_; }

 private:
  static constexpr double kShare = 0.8;        // of the deadline; the rest covers what cannot be foreseen
  static constexpr double kLeastUnits = 1000;  // some 10 us: refinement never starves
  static constexpr double kMostUnits = 1 << 20;
  static constexpr std::uint32_t kMeaningful = 200;
  static constexpr double kRise = 0.3, kFall = 0.01;  // believe a dear cycle at once, a cheap one slowly
  std::int64_t deadline_;
  double unit_ns_ = 10;
  double other_ns_ = 5000;
};

}  // namespace tactus::hrtc_service
