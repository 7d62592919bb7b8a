#include "session/transit.hpp"

#include <algorithm>

namespace tactus::session {

void TransitEstimator::on_transit(std::int64_t transit_ns, std::int64_t now_ns) noexcept {
  const std::int64_t number = now_ns / kTenthNs;
  Tenth& tenth = tenths_[static_cast<std::size_t>(number) % kTenths];
  if (tenth.number != number) tenth = {number, transit_ns};
  tenth.transit_ns = std::max(tenth.transit_ns, transit_ns);
  std::int64_t worst = 0, next = 0;
  int filled = 0;
  for (Tenth& one : tenths_) {
    if (one.number > number) one = {};
    if (one.number < 0 || one.number + static_cast<std::int64_t>(kTenths) <= number) continue;
    ++filled;
    next = std::max(next, std::min(worst, one.transit_ns));
    worst = std::max(worst, one.transit_ns);
  }
  max_ns_ = filled > 1 ? next : worst;
}

}  // namespace tactus::session
