#include "tests/support/random_model.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "spm/checksum.hpp"
#include "spm/morton.hpp"

namespace tactus::test_support {
namespace {

using spm::BornRef;
using spm::DeformedRef;
using spm::kNone;
using spm::RecordPart;

constexpr std::uint32_t kBaseVertices = 6, kBaseFaces = 8;  // of an octahedron

struct Face {
  std::array<std::uint32_t, 3> corners;
  std::uint32_t last_record = kNone;  // last record that added or changed the face; kNone: none did
};

class RandomModelBuilder {
 public:
  RandomModelBuilder(std::uint64_t seed, std::uint32_t records) : random_{seed}, records_{records} {
    parts_.resize(records);
    dependencies_.resize(records);
    model_.positions = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    faces_of_vertex_.resize(kBaseVertices);
    for (std::uint32_t i = 0; i < kBaseFaces; ++i) add_face({i & 1u, 2 + (i >> 1 & 1u), 4 + (i >> 2)}, kNone);
    for (std::uint32_t r = 0; r < records; ++r) split(r);
  }

  spm::OwnedModel finish(std::uint64_t seed, std::uint32_t cells) {
    mark_finest();
    spm::ModelSummary& summary = model_.summary;
    summary.digest = seed * 0x9e3779b97f4a7c15ull + records_;
    summary.base_vertices = kBaseVertices;
    summary.base_faces = kBaseFaces;
    summary.records = records_;
    summary.vertices = kBaseVertices + records_;
    summary.faces = static_cast<std::uint32_t>(faces_.size());
    summary.metres_per_unit = 0.1;
    measure_radii();
    for (std::uint32_t f = 0; f < kBaseFaces; ++f) {
      const auto& [a, b, c] = base_corners_[f];
      model_.base_faces.push_back(
          {spm::FaceId{f}, base_finest_[f], {spm::VertexId{a}, spm::VertexId{b}, spm::VertexId{c}}});
    }
    for (const std::uint32_t level : levels_) summary.max_level = std::max(summary.max_level, level);
    model_.parts = parts_;
    summary.parts = static_cast<std::uint32_t>(parts_.size());
    set_bounds();
    make_regions(cells);
    return std::move(model_);
  }

 private:
  /// A random number in [0, n).
  std::uint32_t random_below(std::size_t n) { return static_cast<std::uint32_t>(random_() % n); }

  std::uint32_t add_face(std::array<std::uint32_t, 3> corners, std::uint32_t last_record) {
    const auto f = static_cast<std::uint32_t>(faces_.size());
    faces_.push_back({corners, last_record});
    if (last_record == kNone) base_corners_.push_back(corners);
    for (const std::uint32_t v : corners) faces_of_vertex_[v].push_back(f);
    return f;
  }

  void add_vertex_dependency(std::uint32_t record, std::uint32_t v) {
    if (v >= kBaseVertices) dependencies_[record].insert(v - kBaseVertices);
  }

  /// Splits a random vertex t into t and u, deforms some faces of t, and adds faces with u, t and a random vertex x.
  void split(std::uint32_t record) {
    const std::uint32_t u = kBaseVertices + record;
    const std::uint32_t t = random_below(u);
    std::array<float, 3> position = model_.positions[t];
    for (float& c : position) c += std::uniform_real_distribution<float>{-0.2f, 0.2f}(random_);
    model_.positions.push_back(position);
    faces_of_vertex_.emplace_back();
    add_vertex_dependency(record, t);

    std::vector<DeformedRef> deformed;
    std::vector<std::uint32_t> unchanged;
    for (const std::uint32_t f : faces_of_vertex_[t]) {
      if (random_below(2) == 0) {
        unchanged.push_back(f);
        continue;
      }
      Face& face = faces_[f];
      const auto corner =
          static_cast<std::uint32_t>(std::find(face.corners.begin(), face.corners.end(), t) - face.corners.begin());
      if (face.last_record != kNone) dependencies_[record].insert(face.last_record);
      for (const std::uint32_t v : face.corners) add_vertex_dependency(record, v);
      deformed.push_back(DeformedRef::make(spm::FaceId{f}, corner, false));
      face.corners[corner] = u;
      face.last_record = record;
      faces_of_vertex_[u].push_back(f);
    }
    faces_of_vertex_[t] = unchanged;

    std::vector<std::pair<BornRef, std::uint32_t>> born;
    const std::uint32_t count = random_below(20) == 0 ? 5 : 1 + random_below(2);
    for (std::uint32_t i = 0; i < count; ++i) {
      std::uint32_t x = random_below(u);
      if (x == t) x = (t + 1) % u;
      const std::uint32_t order = random_below(2);
      add_vertex_dependency(record, x);
      const std::uint32_t face = add_face(spm::born_face(order, u, t, x), record);
      born.emplace_back(BornRef::make(spm::FaceId{face}, order, false), x);
    }
    store(record, t, born, deformed);
  }

  /// Stores the record in as many parts as its faces need.
  void store(std::uint32_t record, std::uint32_t t, const std::vector<std::pair<BornRef, std::uint32_t>>& born,
             const std::vector<DeformedRef>& deformed) {
    levels_.push_back(1);
    for (const std::uint32_t dependency : dependencies_[record])
      levels_[record] = std::max(levels_[record], levels_[dependency] + 1);
    std::uint32_t part_index = record;
    std::size_t b = 0, d = 0;  // stored born and deformed faces
    for (;;) {
      RecordPart part{};
      part.parent = spm::VertexId{t};
      part.next = kNone;
      for (; b < born.size() && part.born_count < spm::kBornPerPart; ++b, ++part.born_count) {
        part.born[part.born_count] = born[b].first;
        part.born_x[part.born_count] = spm::VertexId{born[b].second};
      }
      for (; d < deformed.size() && part.deformed_count < spm::kDeformedPerPart; ++d) part.add_deformed(deformed[d]);
      const bool needs_part = b < born.size() || d < deformed.size();
      if (needs_part) part.next = spm::PartIndex{static_cast<std::uint32_t>(parts_.size())};
      parts_[part_index] = part;
      if (!needs_part) return;
      part_index = index(part.next);
      parts_.emplace_back();
    }
  }

  /// Marks the finest version of each face: the one that its last record writes.
  void mark_finest() {
    for (std::uint32_t f = 0; f < kBaseFaces; ++f) base_finest_.push_back(faces_[f].last_record == kNone ? 1 : 0);
    for (std::uint32_t r = 0; r < records_; ++r) {
      for (std::uint32_t p = r; p != kNone; p = index(parts_[p].next)) {
        RecordPart& part = parts_[p];
        for (int i = 0; i < part.born_count; ++i)
          part.born[i].bits |= faces_[index(part.born[i].face())].last_record == r ? 1u : 0u;
        for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
          const DeformedRef ref = part.deformed(i);
          part.set_deformed(i, DeformedRef::make(ref.face(), ref.corner(), faces_[index(ref.face())].last_record == r));
        }
      }
    }
  }

  /// Computes the radius of each vertex by its definition: a bound of the distance to each vertex that collapses onto
  /// it, directly or in several steps. Such vertices have larger ids, so the loop runs downwards.
  void measure_radii() {
    const std::size_t vertices = model_.positions.size();
    std::vector<std::vector<std::uint32_t>> descendants(vertices);
    std::uint16_t max = 0;
    for (std::size_t v = vertices; v-- > 0;) {
      double distance = 0;
      for (const std::uint32_t w : descendants[v]) {
        const auto &p = model_.positions[v], &q = model_.positions[w];
        distance = std::max(distance, std::hypot(double{p[0]} - q[0], double{p[1]} - q[1], double{p[2]} - q[2]));
      }
      const std::uint16_t code = spm::safe_radius_code(distance);
      max = std::max(max, code);
      if (v < kBaseVertices) {
        model_.base_radii.insert(model_.base_radii.begin(), code);
        continue;
      }
      for (std::uint32_t p = static_cast<std::uint32_t>(v) - kBaseVertices; p != kNone; p = index(parts_[p].next))
        parts_[p].radius = code;
      std::vector<std::uint32_t>& parent_descendants = descendants[index(parts_[v - kBaseVertices].parent)];
      parent_descendants.push_back(static_cast<std::uint32_t>(v));
      parent_descendants.insert(parent_descendants.end(), descendants[v].begin(), descendants[v].end());
    }
    model_.summary.deviation = spm::radius_of(max);
  }

  void set_bounds() {
    spm::ModelSummary& summary = model_.summary;
    summary.bounds_min = summary.bounds_max = model_.positions[0];
    for (const auto& p : model_.positions) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        summary.bounds_min[axis] = std::min(summary.bounds_min[axis], p[axis]);
        summary.bounds_max[axis] = std::max(summary.bounds_max[axis], p[axis]);
      }
    }
  }

  /// Adds a record, and all records that it depends on, to a closed list.
  void add_with_dependencies(std::uint32_t record, std::set<std::uint32_t>& list) const {
    if (!list.insert(record).second) return;
    for (const std::uint32_t dependency : dependencies_[record]) add_with_dependencies(dependency, list);
  }

  void make_regions(std::uint32_t cells) {
    spm::ModelSummary& summary = model_.summary;
    double extent = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      summary.grid.origin[axis] = summary.bounds_min[axis];
      extent = std::max(extent, double{summary.bounds_max[axis]} - summary.bounds_min[axis]);
    }
    summary.grid.cell_size = extent * 1.001 / cells;
    struct Cell {
      std::array<std::uint16_t, 3> at{};
      std::vector<std::uint32_t> faces;
    };
    std::map<std::uint64_t, Cell> cells_in_order;  // by Morton code
    for (std::uint32_t f = 0; f < faces_.size(); ++f) {
      std::array<std::uint16_t, 3> at{};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double from_origin = model_.positions[faces_[f].corners[0]][axis] - summary.grid.origin[axis];
        at[axis] = static_cast<std::uint16_t>(from_origin / summary.grid.cell_size);
      }
      Cell& cell = cells_in_order[spm::morton(at[0], at[1], at[2])];
      cell.at = at;
      cell.faces.push_back(f);
    }
    for (const auto& [code, cell] : cells_in_order) {
      std::set<std::uint32_t> list;
      for (const std::uint32_t f : cell.faces) {
        if (faces_[f].last_record != kNone) add_with_dependencies(faces_[f].last_record, list);
      }
      add_region(cell.at, list, static_cast<std::uint32_t>(cell.faces.size()));
    }
    summary.regions = static_cast<std::uint32_t>(model_.regions.size());
    const std::vector<std::uint32_t> checksums = spm::region_checksums(model_.model());
    for (std::size_t i = 0; i < checksums.size(); ++i) model_.regions[i].checksum = checksums[i];
  }

  void add_region(const std::array<std::uint16_t, 3>& cell, const std::set<std::uint32_t>& list, std::uint32_t faces) {
    spm::Region region{};
    region.cell = cell;
    region.occupied = {~0u, ~0u};
    region.face_count = faces;
    region.first_interval = static_cast<std::uint32_t>(model_.intervals.size());
    region.record_count = static_cast<std::uint32_t>(list.size());
    for (const std::uint32_t r : list) {
      for (std::uint32_t p = r; p != kNone; p = index(parts_[p].next)) ++region.part_count;
      if (model_.intervals.size() > region.first_interval &&
          model_.intervals.back().first + model_.intervals.back().count == r) {
        ++model_.intervals.back().count;
      } else {
        model_.intervals.push_back({r, 1});
      }
    }
    region.interval_count = static_cast<std::uint32_t>(model_.intervals.size()) - region.first_interval;
    model_.regions.push_back(region);
  }

  std::mt19937_64 random_;
  std::uint32_t records_;
  spm::OwnedModel model_;
  std::vector<RecordPart> parts_;
  std::vector<std::set<std::uint32_t>> dependencies_;  // by record
  std::vector<std::uint32_t> levels_;                  // by record
  std::vector<Face> faces_;
  std::vector<std::vector<std::uint32_t>> faces_of_vertex_;
  std::vector<std::array<std::uint32_t, 3>> base_corners_;
  std::vector<std::uint32_t> base_finest_;
};

}  // namespace

spm::OwnedModel random_model(std::uint64_t seed, std::uint32_t records, std::uint32_t cells) {
  return RandomModelBuilder{seed, records}.finish(seed, cells);
}

}  // namespace tactus::test_support
