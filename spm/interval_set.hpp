/// A set of records as ascending intervals: what somebody holds of a model, in a few intervals where a bit per record
/// would take hundreds of kilobytes. Records of neighbouring regions lie beside each other, so that 200 regions are
/// some 350 intervals and 3,000 some 1,200 (organ of 3 million faces).
///
/// Bounded: of more intervals than are allowed the shortest are forgotten, so that the set may hold less than was
/// added, never more.
///
/// Threads: one.
#pragma once

#include <cstddef>
#include <vector>

#include "spm/model.hpp"
#include "spm/span.hpp"

namespace tactus::spm {

class IntervalSet {
 public:
  void clear() noexcept { runs_.clear(); }
  /// Ascending intervals that do not overlap; at most `most` (8 bytes each) are left. O(intervals held + intervals
  /// added).
  void add(Span<const Interval> added, std::size_t max);
  /// Those of ascending `intervals` that are not in the set. O(intervals held + intervals).
  [[nodiscard]] std::vector<Interval> missing(Span<const Interval> intervals) const;

  [[nodiscard]] const std::vector<Interval>& intervals() const noexcept { return runs_; }

 private:
  void forget_shortest(std::size_t left);

  std::vector<Interval> runs_;  // ascending, none touches the next
};

}  // namespace tactus::spm
