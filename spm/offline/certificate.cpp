#include "spm/offline/certificate.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "spm/directory.hpp"
#include "spm/forest.hpp"
#include "spm/region_grid.hpp"

namespace tactus::spm::offline {
namespace {

/// Squared distance between a cube and the nearest occupied subcell of a cell. `cube`: its lowest corner.
double squared_distance(const CellBox& box, const std::array<std::uint32_t, 2>& occupied, const Vec3d& cube,
                        double edge) {
  const double quarter = (box.high[0] - box.low[0]) / 4;
  double apart[3][4];
  for (int axis = 0; axis < 3; ++axis)
    for (int i = 0; i < 4; ++i) {
      const double low = box.low[axis] + i * quarter;
      const double d = std::max({low - (cube[axis] + edge), cube[axis] - (low + quarter), 0.0});
      apart[axis][i] = d * d;
    }
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t bit = 0; bit < 64; ++bit)
    if ((occupied[bit / 32] >> bit % 32 & 1u) != 0)
      nearest = std::min(nearest, apart[0][bit % 4] + apart[1][bit / 4 % 4] + apart[2][bit / 16]);
  return nearest;
}

/// The cubes of a certificate that have regions, and the regions of each cube.
class Cubes {
 public:
  Cubes(const Model& model, double radius)
      : edge_{std::max(model.summary.grid.cell_size / 4, radius / 2)},
        // The origin is so low that the coordinates of all cubes are positive.
        origin_{Vec3d{model.summary.grid.origin[0], model.summary.grid.origin[1], model.summary.grid.origin[2]} -
                Vec3d::Constant(std::ceil(radius / edge_ + 2) * edge_)} {
    const RegionGrid grid{model.summary.grid, model.regions};
    const double reach = radius + 1e-9 * model.summary.grid.cell_size;  // the rounding margin of RegionGrid
    std::vector<Intersection> intersections;
    for (std::uint32_t i = 0; i < grid.size(); ++i)
      add(grid.box(RegionId{i}), model.regions[i].occupied, i, reach, intersections);
    std::sort(intersections.begin(), intersections.end(), [](const Intersection& a, const Intersection& b) {
      return a.key != b.key ? a.key < b.key : a.region < b.region;
    });
    regions_.reserve(intersections.size());
    for (const Intersection& intersection : intersections) {
      if (keys_.empty() || keys_.back() != intersection.key) {
        keys_.push_back(intersection.key);
        first_.push_back(regions_.size());
      }
      regions_.push_back(intersection.region);
    }
    first_.push_back(regions_.size());
  }

  [[nodiscard]] double edge() const noexcept { return edge_; }
  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(keys_.size()); }
  /// The regions of a cube, ascending.
  [[nodiscard]] std::span<const std::uint32_t> regions(std::uint32_t cube) const noexcept {
    return std::span<const std::uint32_t>{regions_}.subspan(first_[cube], first_[cube + 1] - first_[cube]);
  }
  [[nodiscard]] Vec3d centre(std::uint32_t cube) const noexcept {
    return origin_ + edge_ * Vec3d{coordinate(keys_[cube], 0) + 0.5, coordinate(keys_[cube], 1) + 0.5,
                                   coordinate(keys_[cube], 2) + 0.5};
  }
  /// All cubes, row by row; the rows are parallel to `axis`.
  [[nodiscard]] std::vector<std::uint32_t> rows_along(int axis) const {
    const auto rotated_key = [&](std::uint32_t cube) {
      const std::uint64_t key = keys_[cube];
      const int down = (2 - axis) * kBits;
      return (key << (3 * kBits - down) | key >> down) & kKeyMask;
    };
    std::vector<std::uint32_t> order(size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return rotated_key(a) < rotated_key(b); });
    return order;
  }
  /// True if `next` comes directly after `cube` on the axis.
  [[nodiscard]] bool are_neighbours(std::uint32_t cube, std::uint32_t next, int axis) const noexcept {
    return keys_[next] - keys_[cube] == std::uint64_t{1} << (2 - axis) * kBits;
  }

 private:
  struct Intersection {
    std::uint64_t key;  // coordinates of the cube: x in the highest bits, z in the lowest
    std::uint32_t region;
  };
  static constexpr int kBits = 21;
  static constexpr std::uint64_t kKeyMask = (std::uint64_t{1} << 3 * kBits) - 1;

  [[nodiscard]] static double coordinate(std::uint64_t key, int axis) noexcept {
    return static_cast<double>(key >> (2 - axis) * kBits & ((1u << kBits) - 1));
  }
  /// Adds an intersection for each cube in which a sphere with radius `reach` can intersect the region.
  void add(const CellBox& box, const std::array<std::uint32_t, 2>& occupied, std::uint32_t region, double reach,
           std::vector<Intersection>& intersections) const {
    std::array<std::uint64_t, 3> low{}, high{};
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      low[k] = static_cast<std::uint64_t>((box.low[axis] - reach - origin_[axis]) / edge_);
      high[k] = static_cast<std::uint64_t>((box.high[axis] + reach - origin_[axis]) / edge_);
    }
    for (std::uint64_t x = low[0]; x <= high[0]; ++x)
      for (std::uint64_t y = low[1]; y <= high[1]; ++y)
        for (std::uint64_t z = low[2]; z <= high[2]; ++z) {
          const Vec3d corner = origin_ + edge_ * Vec3d{double(x), double(y), double(z)};
          if (squared_distance(box, occupied, corner, edge_) > reach * reach) continue;
          intersections.push_back({x << 2 * kBits | y << kBits | z, region});
        }
  }

  double edge_;
  Vec3d origin_;
  std::vector<std::uint64_t> keys_;     // by cube, ascending
  std::vector<std::size_t> first_;      // by cube: start in regions_; last: end of regions_
  std::vector<std::uint32_t> regions_;  // of all cubes
};

/// The region lists in atoms. An atom is a maximal interval of records that are in the same lists.
struct Atoms {
  std::vector<Interval> intervals;            // intervals of the model, counted in atoms
  std::vector<std::uint32_t> records, parts;  // number of records and parts, by atom
  std::vector<std::uint32_t> faces;           // number of born and deformed faces, by atom
  std::vector<std::uint32_t> leaves;          // leaves of the tree with faces that the atom bears; of all atoms
  std::vector<std::size_t> first_leaf{0};     // by atom: start in `leaves`; last: end of `leaves`

  explicit Atoms(const Model& model) {
    std::vector<bool> begins(std::size_t{model.summary.records} + 1, false);
    for (const Interval& interval : model.intervals)
      begins[interval.first] = begins[interval.first + interval.count] = true;
    // By record: number of atoms that begin before it.
    std::vector<std::uint32_t> before(std::size_t{model.summary.records} + 1);
    std::uint32_t count = 0;
    for (std::uint32_t r = 0; r < model.summary.records; ++r) {
      before[r] = count;
      if (begins[r]) {
        if (count > 0) end_atom();
        records.push_back(0);
        parts.push_back(0);
        faces.push_back(0);
        ++count;
      }
      if (count == 0) continue;
      ++records.back();
      for (PartIndex p{r}; p != kNone; p = model.parts[p].next) {
        const RecordPart& part = model.parts[p];
        ++parts.back();
        faces.back() += part.born_count + part.deformed_count;
        for (int i = 0; i < part.born_count; ++i) leaves.push_back(index(part.born[i].face()) >> 3);
      }
    }
    if (count > 0) end_atom();
    before[model.summary.records] = count;
    intervals.reserve(model.intervals.size());
    for (const Interval& interval : model.intervals)
      intervals.push_back({before[interval.first], before[interval.first + interval.count] - before[interval.first]});
  }

 private:
  void end_atom() {
    const auto from = leaves.begin() + static_cast<std::ptrdiff_t>(first_leaf.back());
    std::sort(from, leaves.end());
    leaves.erase(std::unique(from, leaves.end()), leaves.end());
    first_leaf.push_back(leaves.size());
  }
};

/// Counts the tree nodes above the base mesh and above the faces that some atoms bear.
class ShownNodes {
 public:
  ShownNodes(const Model& model, const Atoms& atoms) : atoms_{atoms} {
    for (std::uint64_t nodes = model.summary.faces; nodes > 1 || shown_.empty();)
      shown_.emplace_back(nodes = (nodes + 7) / 8, 0);
    for (const BaseFace& face : model.base_faces) add_node(index(face.face) >> 3);
  }
  void add(std::uint32_t atom) {
    for (std::size_t i = atoms_.first_leaf[atom]; i < atoms_.first_leaf[atom + 1]; ++i) add_node(atoms_.leaves[i]);
  }
  void remove(std::uint32_t atom) {
    for (std::size_t i = atoms_.first_leaf[atom]; i < atoms_.first_leaf[atom + 1]; ++i) remove_node(atoms_.leaves[i]);
  }
  [[nodiscard]] std::uint32_t count() const noexcept { return count_; }

 private:
  void add_node(std::uint32_t id) {
    for (std::size_t level = 0; level < shown_.size() && shown_[level][id]++ == 0; ++level, id >>= 3) ++count_;
  }
  void remove_node(std::uint32_t id) {
    for (std::size_t level = 0; level < shown_.size() && --shown_[level][id] == 0; ++level, id >>= 3) --count_;
  }

  const Atoms& atoms_;
  // By level from 1 on, and by node: number of child nodes that exist. At level 1: number of atoms and base faces.
  std::vector<std::vector<std::uint32_t>> shown_;
  std::uint32_t count_ = 0;
};

/// The union of the lists of some regions. Regions can be added and removed.
class Union {
 public:
  /// If `nodes` is not null, adds and removes the atoms there too.
  Union(const Model& model, const Atoms& atoms, ShownNodes* nodes)
      : model_{model}, atoms_{atoms}, nodes_{nodes}, listed_(atoms.records.size(), 0) {}
  void add(std::uint32_t region) {
    for (const Interval& interval : intervals_of(region))
      for (std::uint32_t atom = interval.first; atom < interval.first + interval.count; ++atom)
        if (listed_[atom]++ == 0) {
          records_ += atoms_.records[atom];
          parts_ += atoms_.parts[atom];
          changed_faces_ += atoms_.faces[atom];
          if (nodes_ != nullptr) nodes_->add(atom);
        }
  }
  void remove(std::uint32_t region) {
    for (const Interval& interval : intervals_of(region))
      for (std::uint32_t atom = interval.first; atom < interval.first + interval.count; ++atom)
        if (--listed_[atom] == 0) {
          records_ -= atoms_.records[atom];
          parts_ -= atoms_.parts[atom];
          changed_faces_ += atoms_.faces[atom];
          if (nodes_ != nullptr) nodes_->remove(atom);
        }
  }
  [[nodiscard]] std::uint32_t records() const noexcept { return records_; }
  [[nodiscard]] std::uint32_t parts() const noexcept { return parts_; }
  /// Returns the number of changes of faces (added, removed or deformed) since the previous call.
  [[nodiscard]] std::uint32_t take_changed_faces() noexcept { return std::exchange(changed_faces_, 0); }

 private:
  [[nodiscard]] std::span<const Interval> intervals_of(std::uint32_t region) const noexcept {
    const Region& r = model_.regions[region];
    return std::span<const Interval>{atoms_.intervals}.subspan(r.first_interval, r.interval_count);
  }
  const Model& model_;
  const Atoms& atoms_;
  ShownNodes* nodes_;
  std::vector<std::uint32_t> listed_;
  std::uint32_t records_ = 0, parts_ = 0, changed_faces_ = 0;
};

/// Calls `visit` with each value of `a` that `b` does not have. Both are ascending.
template <class Visit>
void for_each_only_in(std::span<const std::uint32_t> a, std::span<const std::uint32_t> b, Visit&& visit) {
  std::size_t at = 0;
  for (const std::uint32_t value : a) {
    while (at < b.size() && b[at] < value) ++at;
    if (at == b.size() || b[at] != value) visit(value);
  }
}

/// Returns the messages that a host sends to an HRTC that has the regions `before` and needs the regions `now`.
std::vector<Certificate::RegionMessage> messages_of_step(const Model& model, std::span<const std::uint32_t> before,
                                                         std::span<const std::uint32_t> now) {
  std::vector<bool> present(model.summary.records, false);
  for (const std::uint32_t region : before)
    for (const Interval& interval : model.intervals_of(RegionId{region}))
      std::fill(present.begin() + interval.first, present.begin() + interval.first + interval.count, true);
  std::vector<Certificate::RegionMessage> messages;
  for_each_only_in(now, before, [&](std::uint32_t region) {
    std::vector<Interval> missing;
    for (const Interval& interval : model.intervals_of(RegionId{region}))
      for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) {
        if (present[r]) continue;
        present[r] = true;
        if (!missing.empty() && missing.back().first + missing.back().count == r)
          ++missing.back().count;
        else
          missing.push_back({r, 1});
      }
    messages.push_back({RegionId{region}, std::move(missing)});
  });
  return messages;
}

}  // namespace

Certificate certify(const Model& model, double radius, double speed) {
  const Cubes cubes{model, radius};
  const Atoms atoms{model};
  Certificate certificate{};
  certificate.radius = radius;
  certificate.speed = speed;
  certificate.step = cubes.edge();
  // Cubes; kNone: outside all cubes.
  std::uint32_t worst_cube = kNone, from = kNone, to = kNone;
  std::uint32_t work_from = kNone, work_to = kNone;
  const auto update_entering = [&](std::uint32_t records, std::uint32_t before, std::uint32_t now) {
    if (records <= certificate.entering_records) return;
    certificate.entering_records = records;
    from = before;
    to = now;
  };
  const auto regions = [&](std::uint32_t cube) {
    return cube == kNone ? std::span<const std::uint32_t>{} : cubes.regions(cube);
  };
  ShownNodes nodes{model, atoms};
  certificate.nodes = nodes.count();
  for (int axis = 0; axis < 3; ++axis) {
    Union needed{model, atoms, axis == 0 ? &nodes : nullptr};
    std::uint32_t before = kNone;
    // Counts the work and the entering records of the step from cube `before` to cube `now`, and of the reverse step.
    const auto step = [&](std::uint32_t now) {
      const std::uint32_t had = needed.records();
      std::uint32_t visits = 0;
      for_each_only_in(regions(now), regions(before), [&](std::uint32_t region) {
        needed.add(region);
        visits += model.regions[region].record_count;
      });
      const std::uint32_t both = needed.records();
      for_each_only_in(regions(before), regions(now), [&](std::uint32_t region) {
        needed.remove(region);
        visits += model.regions[region].record_count;
      });
      const std::uint32_t changes = 2 * both - had - needed.records();
      const std::uint32_t units = visits * Budget::kVisit + changes * Budget::kChange;
      if (units > certificate.work_units) {
        certificate.work_units = units;
        work_from = before;
        work_to = now;
      }
      certificate.faces = std::max(certificate.faces, needed.take_changed_faces());
      update_entering(both - had, before, now);
      update_entering(both - needed.records(), now, before);
      before = now;
    };
    for (const std::uint32_t cube : cubes.rows_along(axis)) {
      if (before != kNone && !cubes.are_neighbours(before, cube, axis)) step(kNone);
      step(cube);
      if (axis > 0) continue;
      std::uint32_t blocks = 0;
      for (const std::uint32_t region : regions(cube))
        blocks += ListBlock::blocks_for(model.regions[region].record_count);
      certificate.blocks = std::max(certificate.blocks, blocks);
      certificate.regions = std::max(certificate.regions, static_cast<std::uint32_t>(regions(cube).size()));
      certificate.records = std::max(certificate.records, needed.records());
      certificate.nodes = std::max(certificate.nodes, nodes.count());
      if (worst_cube != kNone && needed.parts() <= certificate.parts) continue;
      certificate.parts = needed.parts();
      worst_cube = cube;
    }
    step(kNone);
  }
  const Vec3d at = cubes.centre(worst_cube);
  certificate.worst_position = {at[0], at[1], at[2]};
  for (const std::uint32_t region : regions(work_from)) certificate.regions_before.push_back(RegionId{region});
  for (const std::uint32_t region : regions(work_to)) certificate.regions_after.push_back(RegionId{region});
  certificate.messages = messages_of_step(model, regions(from), regions(to));
  return certificate;
}

std::optional<std::uint32_t> slots_needed(const ModelSummary& summary, const Certificate& certificate) noexcept {
  const std::uint32_t min = std::max(summary.base_vertices, (summary.base_faces + 1) / 2) + certificate.parts;
  std::uint32_t low = 0, high = kMaxSlots + 1;
  while (high - low > 1) {  // bisection, because for_slots() computes list blocks and tree nodes from the slots
    const std::uint32_t slots = low + (high - low) / 2;
    const PoolSettings pool = PoolSettings::for_slots(slots);
    const bool fits = slots >= min && pool.list_blocks >= certificate.blocks && pool.tree_nodes >= certificate.nodes;
    (fits ? high : low) = slots;
  }
  if (high > kMaxSlots) return std::nullopt;
  return high;
}

std::optional<std::uint64_t> memory_needed(const ModelSummary& summary, const Certificate& certificate) noexcept {
  constexpr std::uint64_t kStep = 1u << 16;
  const std::optional<std::uint32_t> slots = slots_needed(summary, certificate);
  if (!slots) return std::nullopt;
  for (std::uint64_t bytes = PoolSettings::for_slots(*slots).bytes() / kStep * kStep;; bytes += kStep) {
    const MemoryShares shares = memory_shares(bytes);
    if (shares.pool.slots >= *slots && shares.directories >= directory_bytes(summary, shares.pool)) return bytes;
  }
}

std::uint64_t max_marked(std::uint64_t faces, std::uint64_t finest_faces) {
  std::uint64_t marked = 0;
  for (std::uint64_t level = finest_faces; level > 1;) {
    level = (level + 7) / 8;
    marked += std::min(faces, level);
  }
  return marked;
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
