#include "session/transit.hpp"

#include <algorithm>

namespace tactus::session {

// The result is the second largest of the maxima of the last kBins bins, so that a single outlier does not count.
void TransitEstimator::on_transit(std::int64_t transit_ns, std::int64_t now_ns) noexcept {
  const std::int64_t number = now_ns / kBinNs;
  Bin& bin = bins_[static_cast<std::size_t>(number) % kBins];
  if (bin.number != number) bin = {number, transit_ns};
  bin.transit_ns = std::max(bin.transit_ns, transit_ns);
  std::int64_t largest = 0, second_largest = 0;
  int filled = 0;
  for (Bin& other : bins_) {
    if (other.number > number) other = {};  // the clock has stepped back since then
    if (other.number < 0 || other.number + static_cast<std::int64_t>(kBins) <= number) continue;
    ++filled;
    second_largest = std::max(second_largest, std::min(largest, other.transit_ns));
    largest = std::max(largest, other.transit_ns);
  }
  max_ns_ = filled > 1 ? second_largest : largest;
}

}  // namespace tactus::session
