#include "latency/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>

namespace tactus::latency {

double quantile(const std::vector<double>& sorted, double share) noexcept {
  if (sorted.empty()) return 0;
  constexpr double kRankTolerance = 1e-9;  // rounding of share * count: 0.999 of 1000 is rank 999
  const double count = static_cast<double>(sorted.size());
  const double rank = std::ceil(share * count - kRankTolerance * count);
  return sorted[static_cast<std::size_t>(std::clamp(rank, 1.0, count)) - 1];
}

Summary summarise(std::vector<double>& values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  return {values.size(),          sum / static_cast<double>(values.size()),
          quantile(values, 0.5),  quantile(values, 0.9),
          quantile(values, 0.99), quantile(values, 0.999),
          values.back()};
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
