#include "spm/offline/build.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "spm/offline/closure.hpp"
#include "spm/offline/face_order.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/model_file.hpp"

namespace tactus::spm::offline {
namespace {

void require_surface(const TriangleMesh& mesh, const CleanReport& cleaned) {
  const std::uint32_t dropped = cleaned.non_finite_faces + cleaned.repeated_corner_faces + cleaned.zero_area_faces;
  if (mesh.faces.empty()) {
    throw ModelError{"no surface: found 0 usable triangles (" + std::to_string(dropped) +
                     " degenerate ones dropped), expected at least 1"};
  }
  if (mesh.faces.size() >= kMaxFaces) {
    throw ModelError{"too many faces: found " + std::to_string(mesh.faces.size()) + ", expected below " +
                     std::to_string(kMaxFaces)};
  }
}

/// Turns vertices, faces and collapses of the imported mesh into ids.
class Assembler {
 public:
  Assembler(const TriangleMesh& mesh, const BuildOptions& options, const Progress& progress)
      : mesh_{mesh}, options_{options}, progress_{progress} {}

  BuiltModel run() {
    collapses_ = simplify(mesh_, options_.simplify, [this](double done) { report("simplify", done); });
    report("number", 0);
    needs_ = dependencies(collapses_, mesh_.positions.size());
    set_bounds();
    number_faces();
    number_records();
    write_positions();
    write_base();
    write_records();
    report("divide", 0);
    write_regions();
    ModelSummary& s = out_.summary;
    s.metres_per_unit = options_.size ? *options_.size / longest_side() : options_.metres_per_unit;
    s.deviation = deviation();
    s.digest = digest_of(out_.model());
    report("divide", 1);
    return std::move(out_);
  }

 private:
  void report(std::string_view stage, double done) const {
    if (progress_) progress_(stage, done);
  }

  void set_bounds() {
    ModelSummary& s = out_.summary;
    s.bounds_min.fill(std::numeric_limits<float>::infinity());
    s.bounds_max.fill(-std::numeric_limits<float>::infinity());
    for (const std::array<float, 3>& p : mesh_.positions) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        s.bounds_min[axis] = std::min(s.bounds_min[axis], p[axis]);
        s.bounds_max[axis] = std::max(s.bounds_max[axis], p[axis]);
      }
    }
  }

  double longest_side() const {
    double side = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      side = std::max(side, double{out_.summary.bounds_max[axis]} - double{out_.summary.bounds_min[axis]});
    }
    return side;
  }

  /// Every face shown is the image of its finest self when each corner goes to an ancestor; between corners the motion
  /// is linear, so no point of it moves further than a corner can.
  double deviation() const {
    std::vector<std::uint32_t> parent(mesh_.positions.size(), kNone);
    for (const Collapse& collapse : collapses_.sequence) parent[collapse.u] = collapse.t;
    double squared = 0;
    for (std::uint32_t v = 0; v < parent.size(); ++v)
      for (std::uint32_t above = parent[v]; above != kNone; above = parent[above]) {
        double distance = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const double along = double{mesh_.positions[v][axis]} - double{mesh_.positions[above][axis]};
          distance += along * along;
        }
        squared = std::max(squared, distance);
      }
    return std::sqrt(squared);
  }

  void number_faces() {
    const std::vector<std::uint32_t> order = face_order(mesh_);
    face_id_.resize(order.size());
    for (std::uint32_t i = 0; i < order.size(); ++i) face_id_[order[i]] = i;
  }

  std::uint64_t morton_of(std::uint32_t v) const {
    std::array<std::uint32_t, 3> at{};
    const double side = longest_side();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double share = (double{mesh_.positions[v][axis]} - double{out_.summary.bounds_min[axis]}) / side;
      at[axis] = static_cast<std::uint32_t>(share * 0x1fffff);
    }
    return morton(at[0], at[1], at[2]);
  }

  /// Records ascend by level and within a level along a space-filling curve, so that lists have few runs; base vertices
  /// follow the same curve.
  void number_records() {
    struct Key {
      std::uint32_t level;
      std::uint64_t place;
      std::uint32_t vertex, collapse;
    };
    std::vector<Key> keys(mesh_.positions.size());
    for (std::uint32_t v = 0; v < keys.size(); ++v) keys[v] = {0, morton_of(v), v, kNone};
    for (std::uint32_t i = 0; i < collapses_.sequence.size(); ++i) {
      Key& key = keys[collapses_.sequence[i].u];
      key.level = needs_.level[i];
      key.collapse = i;
    }
    std::sort(keys.begin(), keys.end(), [](const Key& a, const Key& b) {
      if (a.level != b.level) return a.level < b.level;
      return a.place != b.place ? a.place < b.place : a.vertex < b.vertex;
    });
    const std::size_t base = keys.size() - collapses_.sequence.size();
    vertex_id_.resize(keys.size());
    collapse_of_.resize(collapses_.sequence.size());
    record_of_.resize(collapses_.sequence.size());
    for (std::uint32_t i = 0; i < keys.size(); ++i) {
      vertex_id_[keys[i].vertex] = i;
      if (i < base) continue;
      collapse_of_[i - base] = keys[i].collapse;
      record_of_[keys[i].collapse] = static_cast<std::uint32_t>(i - base);
    }
    ModelSummary& s = out_.summary;
    s.vertices = static_cast<std::uint32_t>(keys.size());
    s.base_vertices = static_cast<std::uint32_t>(base);
    s.records = s.vertices - s.base_vertices;
    s.faces = static_cast<std::uint32_t>(mesh_.faces.size());
    s.max_level = needs_.max_level;
  }

  void write_positions() {
    out_.positions.resize(mesh_.positions.size());
    for (std::size_t v = 0; v < vertex_id_.size(); ++v) out_.positions[vertex_id_[v]] = mesh_.positions[v];
  }

  void write_base() {
    std::vector<std::uint8_t> touched(mesh_.faces.size(), 0);
    for (const MovedCorner& moved : collapses_.moved) touched[moved.face] = 1;
    for (std::uint32_t f = 0; f < mesh_.faces.size(); ++f) {
      if (collapses_.alive[f] == 0) continue;
      BaseFace base{face_id_[f], touched[f] == 0 ? 1u : 0u, collapses_.corners[f]};
      for (std::uint32_t& v : base.corners) v = vertex_id_[v];
      out_.base_faces.push_back(base);
    }
    std::sort(out_.base_faces.begin(), out_.base_faces.end(),
              [](const BaseFace& a, const BaseFace& b) { return a.face < b.face; });
    out_.summary.base_faces = static_cast<std::uint32_t>(out_.base_faces.size());
  }

  void write_records() {
    out_.parts.resize(collapse_of_.size());
    for (std::uint32_t r = 0; r < collapse_of_.size(); ++r) {
      const Collapse& c = collapses_.sequence[collapse_of_[r]];
      RecordPart empty{};
      empty.parent = vertex_id_[c.t];
      empty.next = kNone;
      empty.level = needs_.level[collapse_of_[r]];
      std::uint32_t at = r;
      out_.parts[at] = empty;
      std::uint32_t born = 0, moved = 0;
      while (true) {
        RecordPart& part = out_.parts[at];
        for (; born < c.dying_count && part.born_count < kBornPerPart; ++born) {
          const DyingFace& face = collapses_.dying[c.first_dying + born];
          part.born[part.born_count] = BornRef::make(face_id_[face.face], face.order, face.finest);
          part.born_x[part.born_count++] = vertex_id_[face.x];
        }
        for (; moved < c.moved_count && part.deformed_count < kDeformedPerPart; ++moved) {
          const MovedCorner& corner = collapses_.moved[c.first_moved + moved];
          part.deformed[part.deformed_count++] = DeformedRef::make(face_id_[corner.face], corner.corner, corner.finest);
        }
        if (born == c.dying_count && moved == c.moved_count) break;
        part.next = static_cast<std::uint32_t>(out_.parts.size());
        at = part.next;
        out_.parts.push_back(empty);
      }
    }
    out_.summary.parts = static_cast<std::uint32_t>(out_.parts.size());
  }

  void write_regions() {
    std::vector<std::uint32_t> removed_by(mesh_.positions.size(), kNone);
    for (std::uint32_t i = 0; i < collapses_.sequence.size(); ++i) removed_by[collapses_.sequence[i].u] = i;
    const Partition cells = partition(mesh_, options_.partition);
    out_.summary.grid = cells.grid;
    std::vector<std::uint32_t> seen(collapses_.sequence.size(), kNone), stack, list;
    for (std::uint32_t i = 0; i < cells.cells.size(); ++i) {
      if (i % 64 == 0) report("divide", double(i) / double(cells.cells.size()));
      const Cell& cell = cells.cells[i];
      list.clear();
      const auto reach = [&](std::uint32_t collapse) {
        if (collapse == kNone || seen[collapse] == i) return;
        seen[collapse] = i;
        stack.push_back(collapse);
        list.push_back(record_of_[collapse]);
      };
      for (std::uint32_t k = 0; k < cell.face_count; ++k) {
        for (const std::uint32_t v : mesh_.faces[cells.faces[cell.first_face + k]]) reach(removed_by[v]);
      }
      while (!stack.empty()) {
        const std::uint32_t collapse = stack.back();
        stack.pop_back();
        for (const std::uint32_t need : needs_.of(collapse)) reach(need);
      }
      add_region(cell, list);
    }
    out_.summary.regions = static_cast<std::uint32_t>(out_.regions.size());
  }

  void add_region(const Cell& cell, std::vector<std::uint32_t>& list) {
    std::sort(list.begin(), list.end());
    Region region{};
    region.cell = cell.at;
    region.depth = cell.depth;
    region.first_run = static_cast<std::uint32_t>(out_.runs.size());
    region.record_count = static_cast<std::uint32_t>(list.size());
    region.face_count = cell.face_count;
    for (const std::uint32_t r : list) {
      for (std::uint32_t p = r; p != kNone; p = out_.parts[p].next) ++region.part_count;
      if (out_.runs.size() > region.first_run && out_.runs.back().first + out_.runs.back().count == r) {
        ++out_.runs.back().count;
      } else {
        out_.runs.push_back({r, 1});
      }
    }
    region.run_count = static_cast<std::uint32_t>(out_.runs.size()) - region.first_run;
    out_.regions.push_back(region);
  }

  const TriangleMesh& mesh_;
  const BuildOptions& options_;
  const Progress& progress_;
  Collapses collapses_;
  Dependencies needs_;
  std::vector<std::uint32_t> face_id_, vertex_id_;      // by imported number
  std::vector<std::uint32_t> collapse_of_, record_of_;  // by record, by collapse
  BuiltModel out_{};
};

}  // namespace

BuiltModel build_model(TriangleMesh mesh, const BuildOptions& options, const Progress& progress) {
  if (progress) progress("clean", 0);
  const CleanReport cleaned = clean(mesh);
  require_surface(mesh, cleaned);
  BuiltModel built = Assembler{mesh, options, progress}.run();
  built.cleaned = cleaned;
  return built;
}

BuiltModel build_model_file(const std::filesystem::path& path, const BuildOptions& options, const Progress& progress) {
  if (progress) progress("read", 0);
  TriangleMesh mesh = import_mesh(path);
  try {
    return build_model(std::move(mesh), options, progress);
  } catch (const ModelError& e) {
    throw ModelError{path.string() + ": " + e.what()};
  }
}

}  // namespace tactus::spm::offline
