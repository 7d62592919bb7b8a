#include "latency/statistics.hpp"

#include <algorithm>
#include <cstdlib>
#include <numeric>

#include "session/percentile.hpp"

namespace tactus::latency {

Summary summarise(std::vector<double>& values) {
  using session::percentile;
  std::sort(values.begin(), values.end());
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  return {values.size(),
          sum / static_cast<double>(values.size()),
          percentile(values, 0.5),
          percentile(values, 0.9),
          percentile(values, 0.99),
          percentile(values, 0.999),
          percentile(values, 1)};
}

SequenceTally::SequenceTally(std::uint32_t expected) : received_(expected, false) {}

bool SequenceTally::add(std::uint32_t sequence) noexcept {
  if (sequence >= received_.size()) return false;
  if (received_[sequence]) {
    ++duplicates_;
    return false;
  }
  received_[sequence] = true;
  ++unique_;
  if (sequence < next_) ++reordered_;
  next_ = std::max(next_, sequence + 1);
  return true;
}

void InterarrivalJitter::add(std::int64_t sent_ns, std::int64_t received_ns) noexcept {
  const std::int64_t transit = received_ns - sent_ns;
  if (started_) jitter_ns_ += (static_cast<double>(std::llabs(transit - transit_ns_)) - jitter_ns_) / 16;
  transit_ns_ = transit;
  started_ = true;
}

}  // namespace tactus::latency
