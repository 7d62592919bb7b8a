/// Estimates the max transit of nearly all samples, over the last two seconds. The worst tenth of a second is left out,
/// because a single stall should not delay all later samples.
///
/// When session time steps back, because two sessions have merged, measurements from later times are dropped.
/// One thread at a time. Does not allocate.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace tactus::session {

class TransitEstimator {
 public:
  /// Adds the transit of a sample.
  void on_transit(std::int64_t transit_ns, std::int64_t now_ns) noexcept;
  /// The estimate after the last sample; 0: no sample.
  [[nodiscard]] std::int64_t max_ns() const noexcept { return max_ns_; }

 private:
  static constexpr std::size_t kBins = 20;
  static constexpr std::int64_t kBinNs = 100'000'000;
  struct Bin {
    std::int64_t number = -1;
    std::int64_t transit_ns = 0;
  };
  std::array<Bin, kBins> bins_;  // the max transit in each tenth of a second
  std::int64_t max_ns_ = 0;
};

}  // namespace tactus::session
