/// The sizes at which a benchmark measures.
#pragma once

#include <algorithm>
#include <vector>

namespace tactus::bench {

/// Returns `first`, doubled while it is below `last`, and then `last`, so that the row of the largest size always
/// exists. Both are at least 1. Returns only `last` if `first` is not below it.
[[nodiscard]] inline std::vector<int> doubled_counts(int first, int last) {
  std::vector<int> counts;
  for (int count = std::max(first, 1); count < last; count *= 2) counts.push_back(count);
  counts.push_back(last);
  return counts;
}

}  // namespace tactus::bench
