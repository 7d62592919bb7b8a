/// A space-partitioned multi-resolution (SPM) model as flat arrays, as stored in an `.spm` file.
///
/// Model frame. Positions are floats in file units. All references are ids.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (header, base mesh, regions, vertex splits).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "spm/ids.hpp"
#include "spm/morton.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

using Vec3f = Eigen::Vector3f;
using Vec3d = Eigen::Vector3d;

/// A face of the base mesh. Every version of the mesh has a version of this face.
struct BaseFace {
  FaceId face;
  std::uint32_t finest;             ///< 1 if no record deforms the face, so that it has its finest version; else 0
  std::array<VertexId, 3> corners;  ///< below `base_vertices`
};
static_assert(sizeof(BaseFace) == 20);

/// The even partition of the model's bounds. Depth 0 is a regular grid; a dense cell is divided into 8 cells of the
/// next depth. A cell at depth d has the edge length `cell_size / 2^d`. Cell (x, y, z) at depth d has its lowest corner
/// at `origin + (x, y, z) * edge length`. File units.
struct GridFrame {
  std::array<double, 3> origin;
  double cell_size;
  [[nodiscard]] bool operator==(const GridFrame&) const noexcept = default;
};
inline constexpr std::uint32_t kMaxCellDepth = 8;
inline constexpr std::uint32_t kMaxCellsPerSide = 1u << 13;  ///< cells of depth 0 along an axis

/// A region: a labelled cell and its closed list.
struct Region {
  std::array<std::uint16_t, 3> cell;  ///< x, y, z of the cell at its depth
  std::uint16_t depth;
  /// One bit for each of the 4 x 4 x 4 subcells: 1 if finest faces intersect it. Subcell (x, y, z) has bit
  /// x + 4 y + 16 z; the low word comes first.
  std::array<std::uint32_t, 2> occupied;
  std::uint32_t first_interval, interval_count;  ///< intervals of the list in `Model::intervals`
  std::uint32_t record_count;                    ///< number of records in the list
  std::uint32_t part_count;                      ///< number of pool slots that these records need
  std::uint32_t face_count;                      ///< number of finest faces that intersect the cell
  std::uint32_t checksum;                        ///< checksum of the list, see checksum.hpp
};
static_assert(sizeof(Region) == 40);

/// Length and checksum of a region's list, from the base mesh. A message with another list is malformed.
struct ListSummary {
  std::uint32_t records = 0;   ///< Region::record_count
  std::uint32_t checksum = 0;  ///< Region::checksum
};
[[nodiscard]] constexpr ListSummary list_summary(const Region& region) noexcept {
  return {region.record_count, region.checksum};
}

/// The consecutive record ids `[first, first + count)`. Between two intervals of a region, at least one id is missing.
struct Interval {
  std::uint32_t first, count;
};

/// Sizes and properties of a model. The base mesh message begins with them.
struct ModelSummary {
  std::uint64_t digest;                     ///< XXH3-64 of this summary (with digest 0) and all arrays of the model
  std::uint32_t vertices, faces;            ///< counts in the finest mesh
  std::uint32_t base_vertices, base_faces;  ///< counts in the base mesh
  std::uint32_t records;                    ///< vertices - base_vertices
  std::uint32_t parts;                      ///< number of record parts
  std::uint32_t regions;
  std::uint32_t max_level;                      ///< maximum level of a record: length of the longest dependency chain
  std::array<float, 3> bounds_min, bounds_max;  ///< bounding box of the vertices, file units
  GridFrame grid;
  double metres_per_unit;  ///< suggestion of `tactus mesh build`, which a host can override for an object
  /// Upper bound of the distance between any version of the mesh and the finest one, in both directions, in file units.
  /// It is the largest radius of a vertex.
  double deviation;
  /// Step of the grid of coordinates in file units. 0: the coordinates are those of the imported file (lossless
  /// profile). Otherwise each coordinate is the float nearest to `bounds_min + n * position_step` with a whole number
  /// n < 2^24 (compact profile).
  double position_step;
  [[nodiscard]] bool operator==(const ModelSummary&) const noexcept = default;
};

/// Longest side of the bounds, file units.
[[nodiscard]] inline double longest_side(const ModelSummary& summary) noexcept {
  double longest = 0;
  for (std::size_t axis = 0; axis < 3; ++axis)
    longest = std::max(longest, double{summary.bounds_max[axis]} - double{summary.bounds_min[axis]});
  return longest;
}

/// Whether hands touch models whose longest side is `metres`. Otherwise the unit is probably wrong.
[[nodiscard]] constexpr bool is_touchable(double metres) noexcept { return metres >= 0.002 && metres <= 2; }

/// A view of a model. The owner of the arrays must outlive the view.
struct Model {
  ModelSummary summary;
  std::span<const std::array<float, 3>> positions;  ///< by VertexId
  std::span<const std::uint16_t> base_radii;        ///< radius codes by VertexId below `base_vertices`, see record.hpp
  std::span<const BaseFace> base_faces;
  IdSpan<PartIndex, const RecordPart> parts;  ///< the first parts of all records, by RecordId; then all other parts
  std::span<const Region> regions;            ///< in the order of the Morton codes of their cells
  std::span<const Interval> intervals;

  [[nodiscard]] std::span<const Interval> intervals_of(RegionId region) const noexcept {
    const Region& r = regions[index(region)];
    return intervals.subspan(r.first_interval, r.interval_count);
  }
  [[nodiscard]] VertexId vertex_of(RecordId record) const noexcept {
    return VertexId{summary.base_vertices + index(record)};
  }
  [[nodiscard]] const RecordPart& first_part(RecordId record) const noexcept { return parts[PartIndex{index(record)}]; }
};

/// A model that owns its arrays.
struct OwnedModel {
  ModelSummary summary{};
  std::vector<std::array<float, 3>> positions;
  std::vector<std::uint16_t> base_radii;
  std::vector<BaseFace> base_faces;
  std::vector<RecordPart> parts;
  std::vector<Region> regions;
  std::vector<Interval> intervals;

  [[nodiscard]] Model model() const {
    return {summary, positions, base_radii, base_faces, IdSpan<PartIndex, const RecordPart>{parts}, regions, intervals};
  }
};

/// The coarsest mesh of a model.
struct BaseMesh {
  ModelSummary summary;
  std::vector<std::array<float, 3>> positions;  ///< positions of the base vertices
  std::vector<std::uint16_t> radii;             ///< radius codes of the base vertices
  std::vector<BaseFace> faces;
};
[[nodiscard]] BaseMesh base_mesh_of(const Model& model);

inline constexpr std::uint32_t kPageSide = 8;  ///< cells of depth 0 along an edge of a page
/// Number of all PageIds.
inline constexpr std::uint32_t kPageIds = 1u << 30;
static_assert(kMaxCellsPerSide / kPageSide == 1u << 10);
/// Returns the page with these coordinates, in edge lengths of pages.
[[nodiscard]] constexpr PageId page_at(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
  return PageId{static_cast<std::uint32_t>(morton(x, y, z))};
}
/// Returns the page that contains a region.
[[nodiscard]] constexpr PageId page_of(const Region& region) noexcept {
  const auto along = [&](std::size_t axis) { return (std::uint32_t{region.cell[axis]} >> region.depth) / kPageSide; };
  return page_at(along(0), along(1), along(2));
}

/// The regions of a page. A page may have none.
struct Page {
  PageId id{};
  std::uint32_t first = 0;  ///< id of its first region; without regions, of the first region of a later page
  /// As in Model, but first_interval and interval_count are 0, because each region message contains its list.
  std::vector<Region> regions;
};
/// Returns a page of a model, from all regions of the model. O(log(regions) + regions of the page), allocates.
[[nodiscard]] Page page_with_id(std::span<const Region> regions, PageId id);

/// Returns for each vertex the maximum distance, in file units, to the vertices that collapse into it, over any number
/// of steps. `parent` contains the parent of each vertex, or kNone for a base vertex. O(vertices x depth of the
/// forest), allocates.
[[nodiscard]] std::vector<double> collapse_distances(std::span<const std::array<float, 3>> positions,
                                                     std::span<const std::uint32_t> parent);
/// Returns the radius code of a result of `collapse_distances`, with a margin for its rounding errors.
[[nodiscard]] inline std::uint16_t safe_radius_code(double distance) noexcept {
  return radius_code(distance * (1 + 1e-12));
}

/// Returns descriptions of the defects of a model; empty if it has none. Checks every index, order and count that other
/// code relies on, so that a hostile file or stream causes no access out of bounds. O(size x depth of the forest). The
/// total length of the lists and the mean depth have limits, so a hostile model costs at most some seconds for each MB.
/// Allocates.
[[nodiscard]] std::vector<std::string> violations(const Model& model);
[[nodiscard]] std::vector<std::string> violations(const BaseMesh& base);
/// Checks the regions of a whole model, without their lists. `summary` must have no violations.
[[nodiscard]] std::vector<std::string> violations(const ModelSummary& summary, std::span<const Region> regions);
/// As above, for a page.
[[nodiscard]] std::vector<std::string> violations(const ModelSummary& summary, const Page& page);

/// The corners of faces by FaceId.
using ModelCorners = IdVector<FaceId, std::array<VertexId, 3>>;

/// Returns the corners of the base faces. The corners of other faces are 0. Allocates.
[[nodiscard]] ModelCorners base_corners(const Model& model);

/// Applies a record to `corners`, to which all records before it have been applied. Calls `visit` with the vertices on
/// which the split depends: the two other corners of each deformed face and the third corner of each born face. May
/// visit a vertex several times.
template <class Visit>
void apply_record(const Model& model, RecordId record, ModelCorners& corners, Visit visit) {
  const VertexId u = model.vertex_of(record);
  for_each_change(
      model.parts, PartIndex{index(record)}, u,
      [&](DeformedRef ref) {
        std::array<VertexId, 3>& face = corners[ref.face()];
        visit(face[(ref.corner() + 1) % 3]);
        visit(face[(ref.corner() + 2) % 3]);
        face[ref.corner()] = u;
      },
      [&](BornRef ref, const std::array<VertexId, 3>& face, PartIndex part, std::uint32_t i) {
        corners[ref.face()] = face;
        visit(model.parts[part].born_x[i]);
      });
}

/// Returns the finest mesh as triangles by FaceId, whose corners are indices of `positions`. Applies all records in
/// order. O(size), allocates.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> finest_faces(const Model& model);
/// Returns the base mesh as triangles in the order of `base_faces`. Allocates.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> base_triangles(const Model& model);

}  // namespace tactus::spm
