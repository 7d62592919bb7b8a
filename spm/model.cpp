#include "spm/model.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "spm/checksum.hpp"
#include "spm/morton.hpp"
#include "spm/position_code.hpp"

namespace tactus::spm {
namespace {

constexpr std::size_t kMaxMessages = 20;
/// Parts of all lists together, at most this multiple of the numbers of parts and regions.
constexpr std::uint32_t kMaxMeanLists = 1024;
/// Vertices onto which a vertex collapses, one after the other: mean over all vertices.
constexpr std::uint32_t kMaxMeanDepth = 4096;

/// Collects at most kMaxMessages messages, because a broken file can cause thousands.
class Findings {
  template <class T>
  static decltype(auto) printed(const T& value) {
    if constexpr (Index<T>)
      return index(value);
    else
      return (value);
  }

 public:
  template <class... Parts>
  void add(const Parts&... parts) {
    if (full()) return;
    std::ostringstream text;
    (text << ... << printed(parts));
    messages_.push_back(text.str());
  }
  [[nodiscard]] bool full() const { return messages_.size() >= kMaxMessages; }
  [[nodiscard]] bool none() const { return messages_.empty(); }
  [[nodiscard]] std::vector<std::string> take() { return std::move(messages_); }

 private:
  std::vector<std::string> messages_;
};

bool finite(const std::array<float, 3>& p) { return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]); }

void check_size(Findings& findings, const char* what, std::size_t found, std::uint64_t expected) {
  if (found != expected) findings.add(what, ": found ", found, " entries, expected ", expected, " as in the summary");
}

void check_grid(const ModelSummary& s, Findings& findings) {
  const double cell = s.grid.cell_size, max_cell = 2 * longest_side(s);
  if (!(cell > 0 && cell <= max_cell)) {
    findings.add("grid cell size: found ", cell, ", expected a positive length of at most ", max_cell,
                 ", twice the longest side of the bounds");
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double low = s.grid.origin[axis], high = low + kMaxCellsPerSide * cell;
    if (!(low <= s.bounds_min[axis] && high >= s.bounds_max[axis])) {
      findings.add("grid origin: found ", low, " on axis ", axis, ", expected that ", kMaxCellsPerSide,
                   " cells from there contain the bounds");
    }
  }
}

void check_summary(const ModelSummary& s, Findings& findings) {
  if (s.vertices >= kMaxVertices) {
    findings.add("vertices: found ", s.vertices, ", expected below ", kMaxVertices);
  }
  if (s.faces == 0 || s.faces >= kMaxFaces) {
    findings.add("faces: found ", s.faces, ", expected 1 to ", kMaxFaces - 1);
  }
  if (s.base_vertices > s.vertices || s.vertices - s.base_vertices != s.records) {
    findings.add("records: found ", s.records, ", expected the ", s.vertices, " vertices minus the ", s.base_vertices,
                 " base vertices");
  }
  if (s.base_vertices < 3) findings.add("base vertices: found ", s.base_vertices, ", expected at least 3");
  if (s.base_faces == 0 || s.base_faces > s.faces) {
    findings.add("base faces: found ", s.base_faces, ", expected 1 to ", s.faces);
  }
  if (s.parts < s.records || s.parts == kNone) {
    findings.add("parts: found ", s.parts, ", expected at least the ", s.records, " records");
  }
  if (s.faces - s.base_faces > std::uint64_t{kBornPerPart} * s.parts) {
    findings.add("faces: found ", s.faces, ", expected at most the ",
                 s.base_faces + std::uint64_t{kBornPerPart} * s.parts, " for which base mesh and parts have room");
  }
  if (s.regions == 0 || std::uint64_t{s.records} + s.regions >= kMaxVertices) {
    findings.add("regions: found ", s.regions, ", expected at least 1, and below ", kMaxVertices, " together with the ",
                 s.records, " records");
  }
  if (s.max_level > 0xffff || (s.max_level == 0) != (s.records == 0)) {
    findings.add("max level: found ", s.max_level, " with ", s.records, " records");
  }
  if (!finite(s.bounds_min) || !finite(s.bounds_max)) findings.add("bounds: not finite");
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!(s.bounds_min[axis] <= s.bounds_max[axis])) findings.add("bounds: minimum above maximum on axis ", axis);
  }
  check_grid(s, findings);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double steps = (double{s.bounds_max[axis]} - double{s.bounds_min[axis]}) / s.position_step;
    if (s.position_step != 0 && !(s.position_step > 0 && std::isfinite(s.position_step) && steps < 1 << 24)) {
      findings.add("position step: found ", s.position_step, ", expected 0 or a length such that axis ", axis,
                   " has less than 2^24 steps");
    }
  }
  double squared_diagonal = 0;
  for (std::size_t axis = 0; axis < 3; ++axis)
    squared_diagonal += std::pow(double{s.bounds_max[axis]} - double{s.bounds_min[axis]}, 2);
  constexpr double kRounding = 1.07, kTiny = 1e-37;  // of a radius code, and below the exact ones
  if (!(s.deviation >= 0 && s.deviation <= kRounding * std::sqrt(squared_diagonal) + kTiny)) {
    findings.add("deviation: found ", s.deviation, ", expected at most the diagonal of the bounds");
  }
  if (!(std::isfinite(s.metres_per_unit) && s.metres_per_unit > 0)) {
    findings.add("metres per unit: found ", s.metres_per_unit, ", expected a finite positive factor");
  }
}

void check_positions(const ModelSummary& s, std::span<const std::array<float, 3>> positions, Findings& findings) {
  const PositionCode code{s};
  for (std::size_t v = 0; v < positions.size() && !findings.full(); ++v) {
    if (!finite(positions[v])) {
      findings.add("vertex ", v, ": position not finite");
      continue;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (positions[v][axis] < s.bounds_min[axis] || positions[v][axis] > s.bounds_max[axis]) {
        findings.add("vertex ", v, ": outside of the bounds on axis ", axis);
      } else if (code.decode(axis, code.encode(axis, double{positions[v][axis]})) != positions[v][axis]) {
        findings.add("vertex ", v, ": off the grid of ", s.position_step, " on axis ", axis);
      }
    }
  }
}

void check_radius(const char* what, std::size_t number, std::uint16_t code, double deviation, Findings& findings) {
  if (code >= kRadiusCodes || radius_of(code) > deviation) {
    findings.add(what, " ", number, ": radius code ", code, ", expected a radius of at most the deviation ", deviation);
  }
}

bool distinct(const std::array<VertexId, 3>& c) { return c[0] != c[1] && c[1] != c[2] && c[2] != c[0]; }

void check_base_faces(const ModelSummary& s, std::span<const BaseFace> faces, Findings& findings) {
  std::vector<FaceId> ids;
  ids.reserve(faces.size());
  for (const BaseFace& f : faces) ids.push_back(f.face);
  std::sort(ids.begin(), ids.end());
  if (const auto twice = std::adjacent_find(ids.begin(), ids.end()); twice != ids.end())
    findings.add("base faces: face id ", *twice, " is used twice");
  for (std::size_t i = 0; i < faces.size() && !findings.full(); ++i) {
    const BaseFace& f = faces[i];
    if (index(f.face) >= s.faces) findings.add("base face ", i, ": face id ", f.face, ", expected below ", s.faces);
    if (f.finest > 1) findings.add("base face ", i, ": finest is ", f.finest, ", expected 0 or 1");
    for (const VertexId corner : f.corners) {
      if (index(corner) >= s.base_vertices) {
        findings.add("base face ", i, ": corner ", corner, ", expected below ", s.base_vertices);
      }
    }
    if (!distinct(f.corners)) findings.add("base face ", i, ": has a corner twice");
  }
}

/// Limits the total length of all lists, so that the time of the other checks is linear in the size of the model.
void check_list_lengths(const ModelSummary& s, std::span<const Region> regions, Findings& findings) {
  std::uint64_t parts = 0;
  for (const Region& region : regions) parts += region.part_count;
  const std::uint64_t limit = std::uint64_t{kMaxMeanLists} * (std::uint64_t{s.parts} + s.regions);
  if (parts > limit) findings.add("lists: found ", parts, " parts in all lists together, expected at most ", limit);
}

void check_cells(const ModelSummary& s, std::span<const Region> regions, Findings& findings) {
  std::uint64_t end = 0;  // Morton code after the previous cell, at the maximum depth
  for (std::size_t i = 0; i < regions.size() && !findings.full(); ++i) {
    const Region& r = regions[i];
    if (r.occupied[0] == 0 && r.occupied[1] == 0) findings.add("region ", i, ": no part of its cell is occupied");
    if (r.face_count == 0 || r.face_count > s.faces) {
      findings.add("region ", i, ": ", r.face_count, " faces, expected 1 to ", s.faces);
    }
    if (r.record_count > s.records || r.part_count < r.record_count || r.part_count > s.parts) {
      findings.add("region ", i, ": ", r.record_count, " records in ", r.part_count, " parts, expected at most ",
                   s.records, " in ", s.parts);
    }
    if (r.depth > kMaxCellDepth) {
      findings.add("region ", i, ": depth ", r.depth, ", expected at most ", kMaxCellDepth);
      continue;
    }
    const std::uint32_t largest = std::uint32_t{std::max({r.cell[0], r.cell[1], r.cell[2]})} >> r.depth;
    if (largest >= kMaxCellsPerSide) {
      findings.add("region ", i, ": cell ", largest, " along an axis at depth 0, expected below ", kMaxCellsPerSide);
      continue;
    }
    const std::uint32_t levels = kMaxCellDepth - r.depth;
    const std::uint64_t code = morton(r.cell[0], r.cell[1], r.cell[2]) << 3 * levels;
    if (code < end) findings.add("region ", i, ": its cell is not after that of the previous region");
    end = std::max(end, code + (std::uint64_t{1} << 3 * levels));
  }
}

/// Applies all records in order and checks each of them against the mesh before it.
class RecordChecker {
 public:
  RecordChecker(const Model& model, Findings& findings) : model_{model}, findings_{findings} {
    const ModelSummary& s = model.summary;
    corners_ = ModelCorners{s.faces, {kNone, kNone, kNone}};
    last_record_ = IdVector<FaceId, RecordId>{s.faces, kNone};
    is_finest_ = IdVector<FaceId, bool>{s.faces};
    is_part_used_ = IdVector<PartIndex, bool>{s.parts};
    level_ = IdVector<RecordId, std::uint16_t>{s.records};
    chain_length_ = IdVector<RecordId, std::uint32_t>{s.records};
    first_needed_.reserve(std::size_t{s.records} + 1);
    for (const BaseFace& f : model.base_faces) {
      corners_[f.face] = f.corners;
      is_finest_[f.face] = f.finest != 0;
    }
  }

  void check_records() {
    const ModelSummary& s = model_.summary;
    std::uint32_t max_level = 0;
    for (const RecordId record : ids<RecordId>(s.records)) {
      if (findings_.full()) break;
      record_ = record;
      first_needed_.push_back(needed_.size());
      check_record();
      max_level = std::max<std::uint32_t>(max_level, level_[record_]);
    }
    first_needed_.push_back(needed_.size());
    if (!findings_.none()) return;
    if (max_level != s.max_level) findings_.add("max level: found ", s.max_level, ", expected ", max_level);
    check_radii();
    for (std::uint32_t p = s.records; p < s.parts && !findings_.full(); ++p) {
      if (!is_part_used_[PartIndex{p}]) findings_.add("part ", p, ": belongs to no record");
    }
    for (const FaceId f : ids<FaceId>(s.faces)) {
      if (findings_.full()) break;
      if (corners_[f][0] == kNone) {
        findings_.add("face ", f, ": neither in the base mesh nor born by a record");
      } else if (!is_finest_[f]) {
        findings_.add("face ", f, ": its finest version is not marked as finest");
      }
    }
  }

  void check_lists() {
    IdVector<RecordId, RegionId> in_list{model_.summary.records, kNone};
    std::size_t next_interval = 0;
    for (std::uint32_t i = 0; i < model_.regions.size() && !findings_.full(); ++i) {
      const Region& region = model_.regions[i];
      if (region.first_interval != next_interval || region.interval_count > model_.intervals.size() - next_interval) {
        findings_.add("region ", i, ": intervals ", region.first_interval, " + ", region.interval_count,
                      ", expected to begin at ", next_interval, " and end by ", model_.intervals.size());
        return;
      }
      next_interval += region.interval_count;
      check_list(RegionId{i}, model_.intervals.subspan(region.first_interval, region.interval_count), in_list);
    }
    if (findings_.none() && next_interval != model_.intervals.size()) {
      findings_.add("intervals: ", model_.intervals.size() - next_interval, " belong to no region");
    }
  }

 private:
  void check_record() {
    const VertexId u = model_.vertex_of(record_);
    std::size_t changes = 0;
    for (PartIndex p{index(record_)}; p != kNone;) {
      const RecordPart& part = model_.parts[p];
      ++chain_length_[record_];
      check_part(part, u);
      if (part.born_count == 0 && part.deformed_count == 0)
        findings_.add("record ", record_, ": one of its parts changes no face");
      changes += std::size_t{part.born_count} + part.deformed_count;
      if (findings_.full()) return;
      if (part.next == kNone) break;
      if (index(part.next) < model_.summary.records || index(part.next) >= model_.summary.parts ||
          is_part_used_[part.next]) {
        findings_.add("record ", record_, ": continues in part ", part.next, ", expected an unused one in ",
                      model_.summary.records, " to ", model_.summary.parts);
        return;
      }
      p = part.next;
      is_part_used_[p] = true;
    }
    if (changes > kMaxChanges)
      findings_.add("record ", record_, ": changes ", changes, " faces, expected at most ", kMaxChanges);
    std::uint32_t expected = 1;
    for (std::size_t i = first_needed_.back(); i < needed_.size(); ++i) {
      expected = std::max<std::uint32_t>(expected, 1u + level_[needed_[i]]);
    }
    if (expected > 0xffff) findings_.add("record ", record_, ": depends on more than 65535 levels");
    level_[record_] = static_cast<std::uint16_t>(expected);
  }

  /// Compares each radius with collapse_distances. Tolerates the rounding errors of other machines.
  void check_radii() {
    const ModelSummary& s = model_.summary;
    std::vector<std::uint32_t> parent(s.vertices, kNone);
    for (std::uint32_t r = 0; r < s.records; ++r)
      parent[s.base_vertices + r] = index(model_.first_part(RecordId{r}).parent);
    if (!check_depth(parent)) return;
    const std::vector<double> distances = collapse_distances(model_.positions, parent);
    std::uint16_t max = 0;
    for (std::uint32_t v = 0; v < s.vertices && !findings_.full(); ++v) {
      const bool base = v < s.base_vertices;
      const std::uint16_t code = base ? model_.base_radii[v] : model_.first_part(RecordId{v - s.base_vertices}).radius;
      const std::uint16_t low = radius_code(distances[v] * (1 - 1e-9)), high = radius_code(distances[v] * (1 + 1e-9));
      max = std::max(max, code);
      if (code < low || code > high || code >= kRadiusCodes) {
        findings_.add(base ? "vertex " : "record ", base ? v : v - s.base_vertices, ": radius code ", code,
                      ", expected ", low, " for a distance of ", distances[v]);
      }
    }
    if (findings_.none() && s.deviation != radius_of(max)) {
      findings_.add("deviation: found ", s.deviation, ", expected the largest radius ", radius_of(max));
    }
  }

  /// Returns false and adds a finding if `collapse_distances` would take too long.
  bool check_depth(const std::vector<std::uint32_t>& parent) {
    std::vector<std::uint32_t> depth(parent.size(), 0);
    std::uint64_t sum = 0;
    for (std::size_t v = 0; v < parent.size(); ++v) {
      if (parent[v] == kNone) continue;
      depth[v] = depth[parent[v]] + 1;
      sum += depth[v];
    }
    const std::uint64_t limit = std::uint64_t{kMaxMeanDepth} * parent.size();
    if (sum > limit) findings_.add("vertices: found ", sum, " ancestors of all together, expected at most ", limit);
    return sum <= limit;
  }

  void check_part(const RecordPart& part, VertexId u) {
    const RecordPart& head = model_.first_part(record_);
    const VertexId t = part.parent;
    if (t != head.parent || part.radius != head.radius) {
      findings_.add("record ", record_, ": its parts have different parents or radii");
    }
    if (t >= u) {
      findings_.add("record ", record_, ": parent ", t, ", expected below ", u);
      return;
    }
    if (part.born_count > kBornPerPart || part.deformed_count > kDeformedPerPart) {
      findings_.add("record ", record_, ": ", int{part.born_count}, " born and ", int{part.deformed_count},
                    " deformed faces in a part, expected at most ", kBornPerPart, " and ", kDeformedPerPart);
      return;
    }
    add_needed(t);
    for (int i = 0; i < part.born_count; ++i) check_born(part.born[i], part.born_x[i], t, u);
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) check_deformed(part.deformed(i), t, u);
  }

  void check_born(BornRef born, VertexId x, VertexId t, VertexId u) {
    const FaceId f = born.face();
    if (index(f) >= model_.summary.faces) {
      findings_.add("record ", record_, ": bears face ", f, ", expected below ", model_.summary.faces);
    } else if (corners_[f][0] != kNone) {
      findings_.add("record ", record_, ": bears face ", f, ", which exists already");
    } else if (x >= u || x == t) {
      findings_.add("record ", record_, ": third corner ", x, " of face ", f, ", expected below ", u, " and not ", t);
    } else {
      corners_[f] = born_face(born.order(), u, t, x);
      add_needed(x);
      set_last_record(f, born.is_finest());
    }
  }

  void check_deformed(DeformedRef deformed, VertexId t, VertexId u) {
    const FaceId f = deformed.face();
    if (index(f) >= model_.summary.faces || deformed.corner() > 2) {
      findings_.add("record ", record_, ": deforms corner ", deformed.corner(), " of face ", f,
                    ", expected 0 to 2 and below ", model_.summary.faces);
      return;
    }
    std::array<VertexId, 3>& corners = corners_[f];
    if (corners[0] == kNone || last_record_[f] == record_) {
      findings_.add("record ", record_, ": deforms face ", f, ", which ",
                    corners[0] == kNone ? "does not exist yet" : "it has changed already");
      return;
    }
    if (corners[deformed.corner()] != t) {
      findings_.add("record ", record_, ": deforms corner ", deformed.corner(), " of face ", f, ", where ",
                    corners[deformed.corner()], " is, expected its parent ", t);
      return;
    }
    if (last_record_[f] != kNone) needed_.push_back(last_record_[f]);
    for (std::size_t k = 0; k < 3; ++k) {
      if (k != deformed.corner()) add_needed(corners[k]);
    }
    corners[deformed.corner()] = u;
    set_last_record(f, deformed.is_finest());
  }

  void add_needed(VertexId v) {
    const std::uint32_t base = model_.summary.base_vertices;
    if (index(v) >= base) needed_.push_back(RecordId{index(v) - base});
  }

  void set_last_record(FaceId f, bool is_finest) {
    if (is_finest_[f]) findings_.add("record ", record_, ": changes face ", f, " after its finest version");
    last_record_[f] = record_;
    is_finest_[f] = is_finest;
  }

  void check_list(RegionId region, std::span<const Interval> intervals, IdVector<RecordId, RegionId>& in_list) {
    const std::uint32_t records = model_.summary.records;
    const Region& stated = model_.regions[index(region)];
    std::uint64_t after = 0, record_count = 0, part_count = 0;
    for (std::size_t i = 0; i < intervals.size(); ++i) {
      const Interval interval = intervals[i];
      const bool touches = i > 0 && interval.first <= after;
      if (interval.count == 0 || interval.first >= records || interval.count > records - interval.first || touches) {
        findings_.add("region ", region, ": interval ", interval.first, " + ", interval.count, " after ", after,
                      ", expected ascending intervals below ", records, " with an id between them");
        return;
      }
      after = std::uint64_t{interval.first} + interval.count;
      record_count += interval.count;
    }
    if (record_count != stated.record_count) {
      findings_.add("region ", region, ": ", stated.record_count, " records, expected ", record_count,
                    " as in its intervals");
      return;
    }
    for (const Interval& interval : intervals) {
      for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) {
        in_list[RecordId{r}] = region;
        part_count += chain_length_[RecordId{r}];
        for (std::size_t k = first_needed_[r]; k < first_needed_[r + 1]; ++k) {
          if (in_list[needed_[k]] == region) continue;
          findings_.add("region ", region, ": lists record ", r, " but not record ", needed_[k], ", which it needs");
          return;
        }
      }
    }
    if (part_count != stated.part_count) {
      findings_.add("region ", region, ": ", stated.part_count, " parts, expected ", part_count,
                    " as in its intervals");
    }
  }

  const Model& model_;
  Findings& findings_;
  RecordId record_{};
  ModelCorners corners_;
  IdVector<FaceId, RecordId> last_record_;  // last record that changed the face; kNone if there is none
  IdVector<FaceId, bool> is_finest_;        // the finest version of the face has been reached
  IdVector<PartIndex, bool> is_part_used_;
  IdVector<RecordId, std::uint16_t> level_;
  IdVector<RecordId, std::uint32_t> chain_length_;
  std::vector<RecordId> needed_;  // records that record r needs, from first_needed_[r] to first_needed_[r + 1]
  std::vector<std::size_t> first_needed_;
};

void check_checksums(const Model& model, Findings& findings) {
  const std::vector<std::uint32_t> checksums = region_checksums(model);
  for (std::size_t i = 0; i < model.regions.size() && !findings.full(); ++i) {
    if (model.regions[i].checksum != checksums[i]) {
      findings.add("region ", i, ": checksum ", model.regions[i].checksum, ", expected ", checksums[i],
                   " for its records");
    }
  }
}

}  // namespace

BaseMesh base_mesh_of(const Model& model) {
  BaseMesh base;
  base.summary = model.summary;
  base.positions.assign(model.positions.begin(), model.positions.begin() + model.summary.base_vertices);
  base.radii.assign(model.base_radii.begin(), model.base_radii.end());
  base.faces.assign(model.base_faces.begin(), model.base_faces.end());
  return base;
}

Page page_with_id(std::span<const Region> regions, PageId id) {
  const auto begin = std::lower_bound(regions.begin(), regions.end(), id,
                                      [](const Region& region, PageId wanted) { return page_of(region) < wanted; });
  const auto end = std::upper_bound(begin, regions.end(), id,
                                    [](PageId wanted, const Region& region) { return wanted < page_of(region); });
  Page page{id, static_cast<std::uint32_t>(begin - regions.begin()), {begin, end}};
  for (Region& region : page.regions) region.first_interval = region.interval_count = 0;
  return page;
}

std::vector<double> collapse_distances(std::span<const std::array<float, 3>> positions,
                                       std::span<const std::uint32_t> parent) {
  std::vector<double> max(positions.size(), 0);  // squared until the end
  for (std::size_t v = 0; v < positions.size(); ++v) {
    for (std::uint32_t above = parent[v]; above != kNone; above = parent[above]) {
      double squared = 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double along = double{positions[v][axis]} - double{positions[above][axis]};
        squared += along * along;
      }
      max[above] = std::max(max[above], squared);
    }
  }
  for (double& distance : max) distance = std::sqrt(distance);
  return max;
}

std::vector<std::string> violations(const Model& model) {
  const ModelSummary& s = model.summary;
  Findings findings;
  check_summary(s, findings);
  check_size(findings, "positions", model.positions.size(), s.vertices);
  check_size(findings, "base radii", model.base_radii.size(), s.base_vertices);
  check_size(findings, "base faces", model.base_faces.size(), s.base_faces);
  check_size(findings, "parts", model.parts.size(), s.parts);
  check_size(findings, "regions", model.regions.size(), s.regions);
  if (!findings.none()) return findings.take();
  check_positions(s, model.positions, findings);
  check_base_faces(s, model.base_faces, findings);
  check_list_lengths(s, model.regions, findings);
  check_cells(s, model.regions, findings);
  if (!findings.none()) return findings.take();
  RecordChecker checker{model, findings};
  checker.check_records();
  if (findings.none()) checker.check_lists();
  if (findings.none()) check_checksums(model, findings);
  return findings.take();
}

std::vector<std::string> violations(const BaseMesh& base) {
  const ModelSummary& s = base.summary;
  Findings findings;
  check_summary(s, findings);
  check_size(findings, "base positions", base.positions.size(), s.base_vertices);
  check_size(findings, "base radii", base.radii.size(), s.base_vertices);
  check_size(findings, "base faces", base.faces.size(), s.base_faces);
  if (!findings.none()) return findings.take();
  check_positions(s, base.positions, findings);
  for (std::size_t v = 0; v < base.radii.size() && !findings.full(); ++v) {
    check_radius("vertex", v, base.radii[v], s.deviation, findings);
  }
  check_base_faces(s, base.faces, findings);
  return findings.take();
}

std::vector<std::string> violations(const ModelSummary& summary, std::span<const Region> regions) {
  Findings findings;
  check_size(findings, "regions", regions.size(), summary.regions);
  check_list_lengths(summary, regions, findings);
  check_cells(summary, regions, findings);
  return findings.take();
}

std::vector<std::string> violations(const ModelSummary& summary, const Page& page) {
  Findings findings;
  if (index(page.id) >= kPageIds) findings.add("page: found number ", page.id, ", expected below ", kPageIds);
  if (page.first > summary.regions || page.regions.size() > summary.regions - page.first) {
    findings.add("page ", page.id, ": found regions ", page.first, " + ", page.regions.size(), ", expected at most ",
                 summary.regions);
  }
  if (!findings.none()) return findings.take();
  check_cells(summary, page.regions, findings);
  for (std::size_t i = 0; i < page.regions.size() && findings.none(); ++i) {
    const Region& region = page.regions[i];
    if (page_of(region) != page.id) findings.add("page ", page.id, ": contains a cell of page ", page_of(region));
    if (region.first_interval != 0 || region.interval_count != 0) {
      findings.add("region ", page.first + i, ": has intervals, expected none in a page");
    }
  }
  return findings.take();
}

ModelCorners base_corners(const Model& model) {
  ModelCorners corners{model.summary.faces};
  for (const BaseFace& face : model.base_faces) corners[face.face] = face.corners;
  return corners;
}

std::vector<std::array<std::uint32_t, 3>> base_triangles(const Model& model) {
  std::vector<std::array<std::uint32_t, 3>> triangles;
  triangles.reserve(model.base_faces.size());
  for (const BaseFace& face : model.base_faces)
    triangles.push_back({index(face.corners[0]), index(face.corners[1]), index(face.corners[2])});
  return triangles;
}

std::vector<std::array<std::uint32_t, 3>> finest_faces(const Model& model) {
  ModelCorners corners = base_corners(model);
  for (const RecordId r : ids<RecordId>(model.summary.records)) apply_record(model, r, corners, [](VertexId) {});
  std::vector<std::array<std::uint32_t, 3>> faces;
  faces.reserve(corners.size());
  for (const auto& [a, b, c] : corners) faces.push_back({index(a), index(b), index(c)});
  return faces;
}

}  // namespace tactus::spm
