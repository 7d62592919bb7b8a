/// Statistics of times and sequence numbers.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace tactus::latency {

/// Mean, maximum and percentiles (session/percentile.hpp). All are NaN if there are no values. p999 is the percentile
/// of 99.9 %.
struct Summary {
  std::size_t count = 0;
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  double mean = kNone, p50 = kNone, p90 = kNone, p99 = kNone, p999 = kNone, max = kNone;
};
/// Sorts `values`. O(n log n).
[[nodiscard]] Summary summarise(std::vector<double>& values);

/// Payload rate of a load of `seconds`. `bytes`: received after the first arrival. A load that stalls before its end
/// has a lower rate.
[[nodiscard]] inline double bytes_per_s(std::uint64_t bytes, std::int64_t first_ns, std::int64_t last_ns,
                                        double seconds) noexcept {
  const double passed = std::max(static_cast<double>(last_ns - first_ns) * 1e-9, seconds);
  return passed > 0 ? static_cast<double>(bytes) / passed : 0;
}

/// Counts lost, duplicate and reordered samples by their sequence numbers.
///
/// A sample is a duplicate if its number has arrived before. It is reordered if its number has not arrived before, but
/// a larger number has. A number that never arrives is lost.
class SequenceTally {
 public:
  /// Counts the numbers from 0 to `expected` - 1 and ignores others. Allocates a bit for each number.
  explicit SequenceTally(std::uint32_t expected);
  /// Returns true for the first arrival of a number. O(1), does not allocate.
  bool add(std::uint32_t sequence) noexcept;

  [[nodiscard]] std::uint32_t expected() const noexcept { return static_cast<std::uint32_t>(received_.size()); }
  [[nodiscard]] std::uint32_t unique() const noexcept { return unique_; }
  [[nodiscard]] std::uint32_t lost() const noexcept { return expected() - unique_; }
  [[nodiscard]] std::uint32_t duplicates() const noexcept { return duplicates_; }
  [[nodiscard]] std::uint32_t reordered() const noexcept { return reordered_; }

 private:
  std::vector<bool> received_;
  std::uint32_t next_ = 0;  // largest received number + 1
  std::uint32_t unique_ = 0, duplicates_ = 0, reordered_ = 0;
};

/// Interarrival jitter: the smoothed absolute change of the transit time from one sample to the next. Source: RFC 3550,
/// section 6.4.1.
class InterarrivalJitter {
 public:
  /// Call in order of arrival. A constant offset between the sender's and the receiver's clock has no effect. O(1).
  void add(std::int64_t sent_ns, std::int64_t received_ns) noexcept;
  /// Returns the jitter in microseconds.
  [[nodiscard]] double us() const noexcept { return jitter_ns_ * 1e-3; }

 private:
  bool started_ = false;
  std::int64_t transit_ns_ = 0;
  double jitter_ns_ = 0;
};

}  // namespace tactus::latency
