/// A set of record numbers as ascending intervals.
///
/// Records of neighbouring regions have neighbouring numbers. For the organ of 3 million faces, 200 regions therefore
/// need about 350 intervals and 3,000 regions about 1,200, while a bit for each record would take hundreds of
/// kilobytes. If there are more intervals than allowed, the shortest are removed. The set may therefore lack a number
/// that was added, but it never contains a number that was not added. One thread at a time.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm {

class IntervalSet {
 public:
  void clear() noexcept { intervals_.clear(); }
  /// Adds ascending intervals that do not overlap. If the set then has more than `max` intervals (8 bytes each),
  /// removes the shortest until three quarters of `max` remain. `max` must be at least 4. O(intervals in the set +
  /// added).
  void add(std::span<const Interval> added, std::size_t max);
  /// Returns the numbers in ascending `intervals` that are not in the set. O(intervals in the set + intervals).
  [[nodiscard]] std::vector<Interval> missing(std::span<const Interval> intervals) const;

  [[nodiscard]] const std::vector<Interval>& intervals() const noexcept { return intervals_; }

 private:
  void remove_shortest(std::size_t remaining);

  std::vector<Interval> intervals_;  // ascending, with at least one number between two of them
};

}  // namespace tactus::spm
