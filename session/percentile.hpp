/// Computes percentiles of stored samples. All percentiles of the project are computed in this way.
///
/// The rule is nearest rank, without interpolation: the percentile of a share is the smallest sample x such that at
/// least this share of all samples is at most x. So a percentile is always one of the samples: for share 0 the
/// smallest, for share 1 the largest. Without samples it is NaN, so that every comparison with a bound is false.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <vector>

namespace tactus::session {

/// Index of the percentile among `count` > 0 sorted samples; `share` in [0, 1].
[[nodiscard]] inline std::size_t percentile_index(std::size_t count, double share) noexcept {
  constexpr double kTolerance = 1e-9;  // for rounding errors: share 0.999 of 1000 samples must give rank 999
  const double of = static_cast<double>(count);
  return static_cast<std::size_t>(std::clamp(std::ceil((share - kTolerance) * of), 1.0, of)) - 1;
}

/// Percentile of samples in ascending order. O(1).
template <class Value>
[[nodiscard]] double percentile(const std::vector<Value>& sorted, double share) noexcept {
  if (sorted.empty()) return std::numeric_limits<double>::quiet_NaN();
  return static_cast<double>(sorted[percentile_index(sorted.size(), share)]);
}

/// Stores the samples of one quantity, all or only the newest. One thread at a time.
template <class Value = double>
class Samples {
 public:
  /// Stores all samples.
  Samples() = default;
  /// Stores the newest `capacity` samples; none if it is 0. Writes to all memory at once, so that a program that adds
  /// samples for hours does not grow.
  explicit Samples(std::size_t capacity) : capacity_{capacity}, values_(capacity) { values_.clear(); }

  void reserve(std::size_t count) { values_.reserve(count); }
  void add(Value value) {
    if (values_.size() < capacity_)
      values_.push_back(value);
    else if (!values_.empty())
      values_[next_++ % capacity_] = value;
  }
  void clear() noexcept {
    values_.clear();
    next_ = 0;
  }
  [[nodiscard]] bool empty() const noexcept { return values_.empty(); }
  [[nodiscard]] std::size_t size() const noexcept { return values_.size(); }
  [[nodiscard]] const std::vector<Value>& values() const noexcept { return values_; }
  /// Percentile of the stored samples; NaN without samples or if one of them is NaN. O(size), allocates.
  [[nodiscard]] double percentile(double share) const {
    const auto is_nan = [](Value value) { return std::isnan(static_cast<double>(value)); };
    if (values_.empty() || std::any_of(values_.begin(), values_.end(), is_nan))
      return std::numeric_limits<double>::quiet_NaN();
    std::vector<Value> values = values_;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(percentile_index(values.size(), share));
    std::nth_element(values.begin(), at, values.end());
    return static_cast<double>(*at);
  }
  [[nodiscard]] double max() const { return percentile(1); }
  /// Mean of the stored samples; NaN without samples. O(size).
  [[nodiscard]] double mean() const noexcept {
    return std::accumulate(values_.begin(), values_.end(), 0.0) / static_cast<double>(values_.size());
  }

 private:
  std::size_t capacity_ = std::numeric_limits<std::size_t>::max();
  std::size_t next_ = 0;
  std::vector<Value> values_;
};

}  // namespace tactus::session
