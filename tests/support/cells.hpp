/// Helpers for tests that make the cells of a RegionGrid.
#pragma once

#include <algorithm>
#include <vector>

#include "spm/model.hpp"
#include "spm/morton.hpp"

namespace tactus::test_support {

/// Sorts regions in the order that Model::regions has.
inline void sort_cells(std::vector<spm::Region>& regions) {
  const auto code = [](const spm::Region& region) {
    return spm::morton(region.cell[0], region.cell[1], region.cell[2]) << 3 * (spm::kMaxCellDepth - region.depth);
  };
  std::sort(regions.begin(), regions.end(),
            [&code](const spm::Region& a, const spm::Region& b) { return code(a) < code(b); });
}

}  // namespace tactus::test_support
