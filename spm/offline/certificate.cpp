#include "spm/offline/certificate.hpp"

#include <algorithm>
#include <numeric>
#include <vector>

#include "spm/region_grid.hpp"

namespace tactus::spm::offline {
namespace {

/// Slots of records before r, so that a run's slots are one subtraction.
std::vector<std::uint32_t> slots_before(const Model& model) {
  std::vector<std::uint32_t> sum(std::size_t{model.summary.records} + 1, 0);
  for (std::uint32_t r = 0; r < model.summary.records; ++r) {
    std::uint32_t slots = 0;
    for (std::uint32_t p = r; p != kNone; p = model.parts[p].next) ++slots;
    sum[r + 1] = sum[r] + slots;
  }
  return sum;
}

double squared_distance(const CellBox& a, const CellBox& b) {
  return (a.low - b.high).cwiseMax(b.low - a.high).cwiseMax(0.0).squaredNorm();
}

}  // namespace

Certificate certify(const Model& model, double radius) {
  const RegionGrid grid{model.summary.grid, model.regions};
  const std::vector<std::uint32_t> slots = slots_before(model);
  std::vector<std::uint32_t> by_x(grid.size());
  std::iota(by_x.begin(), by_x.end(), 0u);
  const auto low_x = [&grid](std::uint32_t i) { return grid.box(RegionId{i}).low[0]; };
  std::sort(by_x.begin(), by_x.end(),
            [&](std::uint32_t a, std::uint32_t b) { return low_x(a) != low_x(b) ? low_x(a) < low_x(b) : a < b; });
  const double edge = model.summary.grid.cell_size;  // no cell is longer

  Certificate worst{radius, 0, 0, 0, RegionId{0}};
  std::vector<Run> runs;
  for (std::uint32_t i = 0; i < grid.size(); ++i) {
    const CellBox& box = grid.box(RegionId{i});
    const auto first = std::lower_bound(by_x.begin(), by_x.end(), box.low[0] - 2 * radius - edge,
                                        [&](std::uint32_t region, double x) { return low_x(region) < x; });
    runs.clear();
    std::uint32_t regions = 0;
    for (auto at = first; at != by_x.end() && low_x(*at) <= box.high[0] + 2 * radius; ++at) {
      if (squared_distance(box, grid.box(RegionId{*at})) > 4 * radius * radius) continue;
      ++regions;
      const Span<const Run> list = model.runs_of(RegionId{*at});
      runs.insert(runs.end(), list.begin(), list.end());
    }
    std::sort(runs.begin(), runs.end(), [](const Run& a, const Run& b) { return a.first < b.first; });
    std::uint32_t records = 0, parts = 0, covered = 0;
    for (const Run& run : runs) {
      const std::uint32_t from = std::max(covered, run.first), to = run.first + run.count;
      if (to <= from) continue;
      records += to - from;
      parts += slots[to] - slots[from];
      covered = to;
    }
    worst.regions = std::max(worst.regions, regions);
    worst.records = std::max(worst.records, records);
    if (parts > worst.parts) {
      worst.parts = parts;
      worst.worst = RegionId{i};
    }
  }
  return worst;
}

TreeSize tree_size(std::uint64_t leaves, std::uint32_t width) {
  TreeSize size{0, 0};
  for (std::uint64_t level = leaves; level > 1;) {
    level = (level + width - 1) / width;
    size.nodes += level;
    ++size.levels;
  }
  return size;
}

}  // namespace tactus::spm::offline
