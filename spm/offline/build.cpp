#include "spm/offline/build.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <numeric>
#include <string>
#include <utility>

#include "spm/checksum.hpp"
#include "spm/offline/arrange.hpp"
#include "spm/offline/closure.hpp"
#include "spm/offline/digest.hpp"
#include "spm/offline/face_numbers.hpp"
#include "spm/offline/face_order.hpp"
#include "spm/offline/parallel.hpp"
#include "spm/offline/region_lists.hpp"
#include "spm/offline/snap.hpp"

namespace tactus::spm::offline {
namespace {

/// Throws ModelError if the cleaned mesh has no face, or too many.
void require_surface(const TriangleMesh& mesh, const CleanReport& cleaned) {
  const std::uint32_t dropped = cleaned.non_finite_faces + cleaned.repeated_corner_faces + cleaned.zero_area_faces;
  if (mesh.faces.empty()) {
    throw ModelError{"no surface: found 0 usable triangles (" + std::to_string(dropped) +
                     " degenerate ones dropped), expected at least 1"};
  }
  require_face_count(mesh.faces.size());
}

/// Throws ModelError if cleaning dropped most faces or vertices: the mesh was probably read wrongly. `vertices`,
/// `faces`: numbers before cleaning.
void require_few_losses(std::size_t vertices, std::size_t faces, const CleanReport& cleaned) {
  const auto require = [](const char* what, std::size_t of, std::size_t dropped, const std::string& reasons) {
    if (2 * dropped <= of) return;
    throw ModelError{std::string{"most "} + what + " would be dropped: found " + std::to_string(dropped) + " of " +
                     std::to_string(of) + " unusable (" + reasons +
                     "), expected at most half (tactus-mesh build --allow-losses builds it as it is)"};
  };
  const std::pair<std::uint32_t, const char*> counts[] = {
      {cleaned.non_finite_faces, "with a corner that is not finite"},
      {cleaned.repeated_corner_faces, "with two equal corners"},
      {cleaned.zero_area_faces, "without area"},
      {cleaned.duplicate_faces, "equal to another"}};
  std::string reasons;
  std::size_t dropped = 0;
  for (const auto& [count, reason] : counts) {
    if (count > 0) reasons += (reasons.empty() ? "" : ", ") + std::to_string(count) + " " + reason;
    dropped += count;
  }
  require("faces", faces, dropped, reasons);
  require("vertices", vertices - cleaned.welded_vertices, cleaned.unreferenced_vertices, "no face uses them");
}

/// Numbers the faces in the order of the leaves of the AB-tree, and the vertices in the order of the faces, so that
/// neighbours in space are close in memory.
void reorder(TriangleMesh& mesh, unsigned threads) {
  std::vector<Triangle> faces(mesh.faces.size());
  {
    const std::vector<std::uint32_t> order = face_order(mesh, threads);
    parallel_ranges(faces.size(), kGrain, threads, [&](std::size_t first, std::size_t last) {
      for (std::size_t f = first; f < last; ++f) faces[f] = mesh.faces[order[f]];
    });
  }
  mesh.faces = {};
  std::vector<std::uint32_t> to(mesh.positions.size(), kNone);
  std::vector<std::array<float, 3>> positions;
  positions.reserve(mesh.positions.size());
  for (Triangle& f : faces) {
    for (std::uint32_t& v : f) {
      if (to[v] == kNone) {
        to[v] = static_cast<std::uint32_t>(positions.size());
        positions.push_back(mesh.positions[v]);
      }
      v = to[v];
    }
  }
  mesh.faces = std::move(faces);
  mesh.positions = std::move(positions);
}

/// Builds a model from a clean mesh whose faces are in the order of face_order().
class Assembler {
 public:
  Assembler(const TriangleMesh& mesh, double position_step, const BuildOptions& options, const Progress& progress)
      : mesh_{mesh}, options_{options}, progress_{progress} {
    out_.summary.position_step = position_step;
  }

  BuiltModel run() {
    set_bounds();
    ModelSummary& s = out_.summary;
    s.metres_per_unit = options_.size ? *options_.size / longest_side() : options_.metres_per_unit;
    SimplifyOptions simplification = options_.simplify;
    if (options_.pair_distance > 0) simplification.pair_distance = options_.pair_distance / s.metres_per_unit;
    collapses_ = simplify(mesh_, simplification, options_.threads, [this](double done) { report("simplify", done); });
    report("depend", 0);
    const std::vector<Triangle> base_corners = take_base_corners();
    needs_ = dependencies(collapses_, mesh_.positions.size(), options_.threads);
    collapses_.corners = {};
    report("divide", 0);
    const Partition cells = partition(mesh_, options_.partition, options_.threads);
    RegionLists lists{mesh_, cells, needs_, options_.threads, [this](double done) { report("divide", done); }};
    report("number", 0);
    number_records(lists);
    lists.renumber(record_of_, options_.threads);
    report("list", 0);
    write_positions();
    write_base(base_corners);
    write_records();
    collapses_.segments = {};
    const Model faces = out_.model();
    std::vector<std::uint32_t> checksums;  // by record
    parallel_both(
        options_.threads,
        [&] {
          write_radii();
          write_regions(cells, lists);
        },
        [&] { checksums = record_checksums(faces); });
    number_faces(mesh_, out_.summary, out_.base_faces, out_.parts, options_.threads);
    write_checksums(checksums);
    report("sum up", 0);
    s.digest = digest_of(out_.model());
    report("sum up", 1);
    return std::move(out_);
  }

 private:
  void report(std::string_view stage, double done) const {
    if (progress_) progress_(stage, done);
  }

  std::vector<Triangle> take_base_corners() const {
    std::vector<Triangle> corners;
    for (const std::uint32_t f : collapses_.base) corners.push_back(collapses_.corners[f]);
    return corners;
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

  /// Sets radii and deviation. In a coarser version of a face, each corner is at the position of an ancestor in the
  /// vertex forest. Every point of the face is a linear combination of its corners, so no point moves further than the
  /// corner that moves most.
  void write_radii() {
    ModelSummary& s = out_.summary;
    std::vector<std::uint32_t> parent(s.vertices, kNone);
    for (std::uint32_t r = 0; r < s.records; ++r) parent[s.base_vertices + r] = index(out_.parts[r].parent);
    const std::vector<double> distances = collapse_distances(out_.positions, parent);
    const double max = *std::max_element(distances.begin(), distances.end());
    if (safe_radius_code(max) >= kRadiusCodes) {
      throw ModelError{"too large: a vertex collapses over a distance of " + std::to_string(max)};
    }
    s.deviation = radius_of(safe_radius_code(max));
    out_.base_radii.resize(s.base_vertices);
    std::transform(distances.begin(), distances.begin() + s.base_vertices, out_.base_radii.begin(), safe_radius_code);
    for (std::uint32_t r = 0; r < s.records; ++r) {
      const std::uint16_t code = safe_radius_code(distances[s.base_vertices + r]);
      for (PartIndex p{r}; p != kNone; p = part(p).next) part(p).radius = code;
    }
  }

  /// Returns the first face of each collapse.
  std::vector<std::uint32_t> anchors() const {
    std::vector<std::uint32_t> faces;
    faces.reserve(needs_.size());
    for (const Segment& segment : collapses_.segments) {
      for (std::uint32_t i = 0; i < segment.size(); ++i) {
        const FaceRange own = faces_of(segment, i);
        faces.push_back(own.moved < own.moved_end ? segment.moved[own.moved].face()
                                                  : index(segment.removed_faces[own.removed_faces].face()));
      }
    }
    return faces;
  }

  /// Numbers vertices and records. Base vertices are in the order of `mesh`, records in that of RegionLists::order.
  void number_records(const RegionLists& lists) {
    const auto vertices = static_cast<std::uint32_t>(mesh_.positions.size());
    ModelSummary& s = out_.summary;
    s.vertices = vertices;
    s.records = needs_.size();
    s.base_vertices = s.vertices - s.records;
    s.faces = static_cast<std::uint32_t>(mesh_.faces.size());
    s.max_level = needs_.max_level;
    const std::vector<std::uint32_t> order = lists.order(needs_, anchors(), options_.threads);
    record_of_.resize(order.size());
    for_ranges(order.size(), [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) record_of_[order[i]] = static_cast<std::uint32_t>(i);
    });
    vertex_id_.resize(vertices);
    std::uint32_t base = 0;
    for (std::uint32_t v = 0; v < vertices; ++v) {
      const std::uint32_t collapse = needs_.removed_by[v];
      vertex_id_[v] = collapse == kNone ? base++ : s.base_vertices + record_of_[collapse];
    }
  }

  void for_ranges(std::size_t count, const std::function<void(std::size_t, std::size_t)>& work) const {
    parallel_ranges(count, kGrain, options_.threads, work);
  }

  void write_positions() {
    out_.positions.resize(mesh_.positions.size());
    for_ranges(vertex_id_.size(), [this](std::size_t first, std::size_t last) {
      for (std::size_t v = first; v < last; ++v) out_.positions[vertex_id_[v]] = mesh_.positions[v];
    });
  }

  void write_base(const std::vector<Triangle>& corners) {
    for (std::size_t i = 0; i < corners.size(); ++i) {
      BaseFace base{FaceId{collapses_.base[i]}, collapses_.base_finest[i] ? 1u : 0u, {}};
      std::transform(corners[i].begin(), corners[i].end(), base.corners.begin(),
                     [this](std::uint32_t v) { return VertexId{vertex_id_[v]}; });
      out_.base_faces.push_back(base);
    }
    out_.summary.base_faces = static_cast<std::uint32_t>(out_.base_faces.size());
  }

  void write_records() {
    out_.parts.resize(out_.summary.records);
    /// A record with several parts.
    struct LongRecord {
      std::uint32_t record;
      const Segment* segment;
      std::uint32_t collapse;  // in the segment
    };
    std::vector<std::vector<LongRecord>> long_records(collapses_.segments.size());
    parallel_for(collapses_.segments.size(), options_.threads, [&](std::size_t s, unsigned) {
      const Segment& segment = collapses_.segments[s];
      for (std::uint32_t i = 0; i < segment.size(); ++i) {
        const std::uint32_t record = vertex_id_[segment.sequence[i].u] - out_.summary.base_vertices;
        FaceRange rest = faces_of(segment, i);
        out_.parts[record] = next_part(segment, i, rest);
        if (!rest.empty()) long_records[s].push_back({record, &segment, i});
      }
    });
    std::vector<LongRecord> chains;
    for (const std::vector<LongRecord>& some : long_records) chains.insert(chains.end(), some.begin(), some.end());
    std::sort(chains.begin(), chains.end(),
              [](const LongRecord& a, const LongRecord& b) { return a.record < b.record; });
    for (const LongRecord& chain : chains) {
      FaceRange rest = faces_of(*chain.segment, chain.collapse);
      static_cast<void>(next_part(*chain.segment, chain.collapse, rest));  // the first part, which is written already
      for (PartIndex last{chain.record}; !rest.empty();) {
        last = part(last).next = PartIndex{static_cast<std::uint32_t>(out_.parts.size())};
        out_.parts.push_back(next_part(*chain.segment, chain.collapse, rest));
      }
    }
    out_.summary.parts = static_cast<std::uint32_t>(out_.parts.size());
  }

  [[nodiscard]] RecordPart& part(PartIndex p) { return out_.parts[index(p)]; }

  /// The faces of a collapse that no part has yet, as ranges of Segment::removed_faces and Segment::moved.
  struct FaceRange {
    std::uint32_t removed_faces, dying_end, moved, moved_end;
    [[nodiscard]] bool empty() const { return removed_faces == dying_end && moved == moved_end; }
  };
  static FaceRange faces_of(const Segment& segment, std::uint32_t i) {
    const Collapse &c = segment.sequence[i], &end = segment.sequence[i + 1];
    return {c.first_dying, end.first_dying, c.first_moved, end.first_moved};
  }

  /// Returns the next part of the record of collapse i, and removes its faces from `rest`.
  RecordPart next_part(const Segment& segment, std::uint32_t i, FaceRange& rest) const {
    RecordPart part{};
    part.parent = VertexId{vertex_id_[segment.sequence[i].t]};
    part.next = kNone;
    for (; rest.removed_faces < rest.dying_end && part.born_count < kBornPerPart; ++rest.removed_faces) {
      part.born[part.born_count] = segment.removed_faces[rest.removed_faces];
      part.born_x[part.born_count++] = VertexId{vertex_id_[segment.removed_third_corners[rest.removed_faces]]};
    }
    if (part.born_count == 2 && part.born[0].order() > part.born[1].order()) {
      std::swap(part.born[0], part.born[1]);
      std::swap(part.born_x[0], part.born_x[1]);
    }
    for (; rest.moved < rest.moved_end && part.deformed_count < kDeformedPerPart; ++rest.moved) {
      const MovedCorner& moved = segment.moved[rest.moved];
      part.add_deformed(DeformedRef::make(FaceId{moved.face()}, moved.corner(), moved.is_finest()));
    }
    return part;
  }

  void write_regions(const Partition& cells, const RegionLists& lists) {
    for (std::size_t i = 0; i < cells.cells.size(); ++i) add_region(cells.cells[i], lists.of(i));
    out_.summary.grid = cells.grid;
    out_.summary.regions = static_cast<std::uint32_t>(out_.regions.size());
  }

  void write_checksums(const std::vector<std::uint32_t>& records) {
    const Model model = out_.model();
    parallel_for(out_.regions.size(), options_.threads, [&](std::size_t i, unsigned) {
      out_.regions[i].checksum = region_checksum(model, RegionId{static_cast<std::uint32_t>(i)}, records);
    });
  }

  void add_region(const Cell& cell, std::span<const std::uint32_t> list) {
    Region region{};
    region.cell = cell.at;
    region.depth = cell.depth;
    region.occupied = cell.occupied;
    region.first_interval = static_cast<std::uint32_t>(out_.intervals.size());
    region.record_count = static_cast<std::uint32_t>(list.size());
    region.face_count = cell.face_count;
    for (const std::uint32_t r : list) {
      for (PartIndex p{r}; p != kNone; p = part(p).next) ++region.part_count;
      if (out_.intervals.size() > region.first_interval &&
          out_.intervals.back().first + out_.intervals.back().count == r) {
        ++out_.intervals.back().count;
      } else {
        out_.intervals.push_back({r, 1});
      }
    }
    region.interval_count = static_cast<std::uint32_t>(out_.intervals.size()) - region.first_interval;
    out_.regions.push_back(region);
  }

  const TriangleMesh& mesh_;
  const BuildOptions& options_;
  const Progress& progress_;
  Collapses collapses_;
  Dependencies needs_;
  std::vector<std::uint32_t> vertex_id_;  // vertex id, by vertex of `mesh_`
  std::vector<std::uint32_t> record_of_;  // record id, by collapse
  BuiltModel out_{};
};

}  // namespace

void require_face_count(std::size_t faces) {
  if (faces < kMaxBuiltFaces) return;
  throw ModelError{"too many faces: found " + std::to_string(faces) + ", expected at most " +
                   std::to_string(kMaxBuiltFaces - 1)};
}

BuiltModel build_model(TriangleMesh mesh, const BuildOptions& options, const Progress& progress) {
  if (progress) progress("clean", 0);
  const std::size_t vertices = mesh.positions.size(), faces = mesh.faces.size();
  CleanReport cleaned = clean(mesh, options.threads);
  require_surface(mesh, cleaned);
  if (options.losses == LossPolicy::kRefuse) require_few_losses(vertices, faces, cleaned);
  double step = 0;
  if (options.grid_bits > 0) {
    step = step_of_grid(mesh, options.grid_bits);
    cleaned = cleaned + snap(mesh, step, options.threads);
    require_surface(mesh, cleaned);
  }
  if (progress) progress("order", 0);
  reorder(mesh, options.threads);
  BuiltModel built = Assembler{mesh, step, options, progress}.run();
  built.cleaned = cleaned;
  return built;
}

BuiltModel build_model_file(const std::filesystem::path& path, const BuildOptions& options, const Progress& progress,
                            const std::function<void(const FileNames& requested)>& on_read) {
  if (progress) progress("read", 0);
  FileNames requested;
  TriangleMesh mesh = import_mesh(path, options.losses, &requested);
  if (on_read) on_read(requested);
  try {
    return build_model(std::move(mesh), options, progress);
  } catch (const ModelError& e) {
    throw ModelError{path.string() + ": " + e.what()};
  } catch (const std::bad_alloc&) {
    throw ModelError{path.string() + ": the build needs more memory than this program can get"};
  }
}

}  // namespace tactus::spm::offline
