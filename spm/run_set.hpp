/// A set of records as ascending runs: what somebody holds of a model, in a few runs where a bit per record would take
/// hundreds of kilobytes. Records of neighbouring regions lie beside each other, so that 200 regions are some 350 runs
/// and 3,000 some 1,200 (organ of 3 million faces).
///
/// Bounded: of more runs than are allowed the shortest are forgotten, so that the set may hold less than was added,
/// never more.
///
/// Threads: one.
#pragma once

#include <cstddef>
#include <vector>

#include "spm/model.hpp"
#include "spm/span.hpp"

namespace tactus::spm {

class RunSet {
 public:
  void clear() noexcept { runs_.clear(); }
  /// Ascending runs that do not overlap; at most `most` (8 bytes each) are left. O(runs held + runs added).
  void add(Span<const Run> added, std::size_t most);
  /// Those of ascending `runs` that are not in the set. O(runs held + runs).
  [[nodiscard]] std::vector<Run> missing(Span<const Run> runs) const;

  [[nodiscard]] const std::vector<Run>& runs() const noexcept { return runs_; }

 private:
  void forget_shortest(std::size_t left);

  std::vector<Run> runs_;  // ascending, none touches the next
};

}  // namespace tactus::spm
