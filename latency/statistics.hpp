/// Statistics of a latency test. Percentiles come from stored samples by nearest rank, without interpolation.
#pragma once

#include <cstdint>
#include <vector>

namespace tactus::latency {

/// Smallest value that is at least as large as `share` (0..1) of all; 0 without values. `sorted` ascends. O(1).
[[nodiscard]] double quantile(const std::vector<double>& sorted, double share) noexcept;

struct Summary {
  std::size_t count = 0;
  double mean = 0, p50 = 0, p90 = 0, p99 = 0, p999 = 0, max = 0;
};
/// Sorts `values`. O(n log n).
[[nodiscard]] Summary summarise(std::vector<double>& values);

/// Counts losses, duplicates and reordering of numbered samples.
///
/// A repeated number is a duplicate. A first arrival after a larger number is reordered. A number that never arrives is
/// lost.
class SequenceTally {
 public:
  /// Counts numbers from 0 to `expected` - 1; ignores others. Allocates a bit for each.
  explicit SequenceTally(std::uint32_t expected);
  /// True for the first arrival of a number. O(1), does not allocate.
  bool add(std::uint32_t sequence) noexcept;

  [[nodiscard]] std::uint32_t expected() const noexcept { return static_cast<std::uint32_t>(received_.size()); }
  [[nodiscard]] std::uint32_t unique() const noexcept { return unique_; }
  [[nodiscard]] std::uint32_t lost() const noexcept { return expected() - unique_; }
  [[nodiscard]] std::uint32_t duplicates() const noexcept { return duplicates_; }
  [[nodiscard]] std::uint32_t reordered() const noexcept { return reordered_; }

 private:
  std::vector<bool> received_;
  std::uint32_t next_ = 0;  // above the largest received
  std::uint32_t unique_ = 0, duplicates_ = 0, reordered_ = 0;
};

/// Interarrival jitter: smoothed difference between the spacing at the receiver and at the sender.
/// Source: RFC 3550, section 6.4.1.
class InterarrivalJitter {
 public:
  /// Call in order of arrival; each argument has one clock. O(1).
  void add(std::int64_t sent_ns, std::int64_t received_ns) noexcept;
  [[nodiscard]] double us() const noexcept { return jitter_ns_ * 1e-3; }

 private:
  bool started_ = false;
  std::int64_t transit_ns_ = 0;
  double jitter_ns_ = 0;
};

}  // namespace tactus::latency
