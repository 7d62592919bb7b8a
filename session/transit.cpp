#include "session/transit.hpp"

#include <algorithm>

namespace tactus::session {

// The result is the second largest of the maxima of the last kTenths tenths, so that a single outlier does not count.
void TransitEstimator::on_transit(std::int64_t transit_ns, std::int64_t now_ns) noexcept {
  const std::int64_t number = now_ns / kTenthNs;
  Tenth& tenth = tenths_[static_cast<std::size_t>(number) % kTenths];
  if (tenth.number != number) tenth = {number, transit_ns};
  tenth.transit_ns = std::max(tenth.transit_ns, transit_ns);
  std::int64_t largest = 0, second_largest = 0;
  int filled = 0;
  for (Tenth& one : tenths_) {
    if (one.number > number) one = {};  // of before a step back of the clock
    if (one.number < 0 || one.number + static_cast<std::int64_t>(kTenths) <= number) continue;
    ++filled;
    second_largest = std::max(second_largest, std::min(largest, one.transit_ns));
    largest = std::max(largest, one.transit_ns);
  }
  max_ns_ = filled > 1 ? second_largest : largest;
}

}  // namespace tactus::session
