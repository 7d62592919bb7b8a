/// A set of record numbers as ascending intervals. Records of neighbouring regions have neighbouring numbers, so 200
/// regions are about 350 intervals and 3,000 regions about 1,200 (organ of 3 million faces); a bit for each record
/// would take hundreds of kilobytes.
///
/// Bounded: if there are more intervals than allowed, the shortest are removed, so the set may contain less than was
/// added, never more.
///
/// One thread at a time.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm {

class IntervalSet {
 public:
  void clear() noexcept { intervals_.clear(); }
  /// Adds ascending intervals that do not overlap, and reduces the set to at most `max` intervals (8 bytes each).
  /// O(intervals in the set + added).
  void add(std::span<const Interval> added, std::size_t max);
  /// The parts of ascending `intervals` that are not in the set. O(intervals in the set + intervals).
  [[nodiscard]] std::vector<Interval> missing(std::span<const Interval> intervals) const;

  [[nodiscard]] const std::vector<Interval>& intervals() const noexcept { return intervals_; }

 private:
  void forget_shortest(std::size_t left);

  std::vector<Interval> intervals_;  // ascending, none touches the next
};

}  // namespace tactus::spm
