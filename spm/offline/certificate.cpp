#include "spm/offline/certificate.hpp"

#include <algorithm>
#include <cmath>
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

struct Pair {
  std::uint64_t cube;
  std::uint32_t region;
};

/// The cubes, of a grid with the given edge, from which a ball may meet the region: each with the region, once.
void add_cubes(const CellBox& box, std::uint32_t region, const Vec3d& origin, double edge, double radius,
               std::vector<Pair>& pairs) {
  std::array<std::int64_t, 3> low{}, high{};
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    low[k] = static_cast<std::int64_t>(std::floor((box.low[axis] - radius - origin[axis]) / edge));
    high[k] = static_cast<std::int64_t>(std::floor((box.high[axis] + radius - origin[axis]) / edge));
  }
  for (std::int64_t z = low[2]; z <= high[2]; ++z) {
    for (std::int64_t y = low[1]; y <= high[1]; ++y) {
      for (std::int64_t x = low[0]; x <= high[0]; ++x) {
        const Vec3d at = origin + edge * Vec3d{double(x), double(y), double(z)};
        const Vec3d apart = (box.low - at - Vec3d::Constant(edge)).cwiseMax(at - box.high).cwiseMax(0.0);
        if (apart.squaredNorm() > radius * radius) continue;
        pairs.push_back({std::uint64_t(x) << 42 | std::uint64_t(y) << 21 | std::uint64_t(z), region});
      }
    }
  }
}

struct Group {
  std::uint64_t parts;  ///< of its regions' lists, shared records counted as often as they occur
  std::size_t first, count;
};

}  // namespace

Certificate certify(const Model& model, double radius) {
  const RegionGrid grid{model.summary.grid, model.regions};
  const double cell = model.summary.grid.cell_size;
  const double edge = std::max(cell / 4, radius / 2);
  // The first cube lies so low that no index is negative.
  const Vec3d origin = Vec3d{model.summary.grid.origin[0], model.summary.grid.origin[1], model.summary.grid.origin[2]} -
                       Vec3d::Constant(std::ceil(radius / edge + 2) * edge);
  std::vector<Pair> pairs;
  for (std::uint32_t i = 0; i < grid.size(); ++i) add_cubes(grid.box(RegionId{i}), i, origin, edge, radius, pairs);
  std::sort(pairs.begin(), pairs.end(),
            [](const Pair& a, const Pair& b) { return a.cube != b.cube ? a.cube < b.cube : a.region < b.region; });

  Certificate worst{radius, 0, 0, 0, {}};
  std::vector<Group> groups;
  for (std::size_t i = 0; i < pairs.size();) {
    Group group{0, i, 0};
    for (; i < pairs.size() && pairs[i].cube == pairs[group.first].cube; ++i, ++group.count) {
      group.parts += model.regions[pairs[i].region].part_count;
    }
    worst.regions = std::max(worst.regions, static_cast<std::uint32_t>(group.count));
    groups.push_back(group);
  }
  // A union is no larger than the sum: once the sums fall below the largest union, no larger one can follow.
  std::sort(groups.begin(), groups.end(),
            [](const Group& a, const Group& b) { return a.parts != b.parts ? a.parts > b.parts : a.first < b.first; });
  const std::vector<std::uint32_t> slots = slots_before(model);
  std::vector<Run> runs;
  for (const Group& group : groups) {
    if (group.parts <= worst.records) break;
    runs.clear();
    for (std::size_t k = 0; k < group.count; ++k) {
      const Span<const Run> list = model.runs_of(RegionId{pairs[group.first + k].region});
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
    worst.records = std::max(worst.records, records);
    if (parts <= worst.parts) continue;
    worst.parts = parts;
    const std::uint64_t cube = pairs[group.first].cube;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double at = static_cast<double>(cube >> (42 - 21 * axis) & 0x1fffff);
      worst.worst[axis] = origin[static_cast<int>(axis)] + (at + 0.5) * edge;
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
