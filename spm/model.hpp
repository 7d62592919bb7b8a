/// A whole space-partitioned multi-resolution (SPM) model as flat arrays: the contents of an `.spm` file.
///
/// Model frame. Positions are floats in file units, exactly as imported. All references are ids.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (header, base mesh, regions, vertex splits).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "spm/ids.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

using Vec3f = Eigen::Vector3f;
using Vec3d = Eigen::Vector3d;

/// A face of the base mesh. Some version of it is always shown.
struct BaseFace {
  FaceId face;
  std::uint32_t last;               ///< 1: no record deforms the face, so it is in its finest version
  std::array<VertexId, 3> corners;  ///< below `base_vertices`
};
static_assert(sizeof(BaseFace) == 20);

/// The even partition of the model's bounds. A cell at depth d has the edge `cell_size / 2^d`; cell (x, y, z) at depth
/// d begins at `origin + (x, y, z) * edge`. Depth 0 is the regular grid; dense cells are divided into deeper ones.
struct GridFrame {
  std::array<double, 3> origin;
  double cell_size;
};

/// A labelled cell and the position of its closed record list in `Model::intervals`.
struct Region {
  std::array<std::uint16_t, 3> cell;  ///< x, y, z at its depth
  std::uint16_t depth;
  /// The cell is divided into 4 x 4 x 4 parts. Bit x + 4 y + 16 z, low word first: faces intersect that part.
  std::array<std::uint32_t, 2> occupied;
  std::uint32_t first_interval, interval_count;  ///< in `Model::intervals`
  std::uint32_t record_count;                    ///< length of the list
  std::uint32_t part_count;                      ///< pool slots that its records need
  std::uint32_t face_count;                      ///< finest faces that intersect the cell
  std::uint32_t checksum;                        ///< of its list, see checksum.hpp
};
static_assert(sizeof(Region) == 40);

/// Consecutive record ids `[first, first + count)`. A region's intervals ascend and do not touch.
struct Interval {
  std::uint32_t first, count;
};

/// Sizes and properties of a model; the first part of its base mesh message.
struct ModelSummary {
  std::uint64_t digest;  ///< XXH3-64 of all sections; models with equal digests are equal
  std::uint32_t vertices, faces;
  std::uint32_t base_vertices, base_faces;
  std::uint32_t records;  ///< = vertices - base_vertices
  std::uint32_t parts;    ///< records plus continuation parts
  std::uint32_t regions;
  std::uint32_t max_level;                      ///< of all records: length of the longest dependency chain
  std::array<float, 3> bounds_min, bounds_max;  ///< of the vertices, file units
  GridFrame grid;
  double metres_per_unit;  ///< suggested by `tactus mesh build`; a host can override it for an object
  /// File units. The maximum distance between any version of the mesh and the finest one, in both directions: the
  /// largest radius of a vertex.
  double deviation;
  /// File units. 0: positions are floats as imported (lossless profile). Otherwise each coordinate is the float nearest
  /// to `bounds_min` plus a multiple of this step, below 2^24 steps (compact profile).
  double position_step;
};

/// View of a model. The owner of the arrays must outlive it.
struct Model {
  ModelSummary summary;
  std::span<const std::array<float, 3>> positions;  ///< by VertexId
  std::span<const std::uint16_t> base_radii;        ///< codes by VertexId below `base_vertices`, see record.hpp
  std::span<const BaseFace> base_faces;
  IdSpan<PartIndex, const RecordPart> parts;  ///< the first parts by RecordId, then continuation parts
  std::span<const Region> regions;
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

/// The part of a model that an HRTC needs before the first record: the base mesh and the labelled cells.
struct BaseMesh {
  ModelSummary summary;
  std::vector<std::array<float, 3>> positions;  ///< `base_vertices` of them
  std::vector<std::uint16_t> radii;             ///< of these vertices, as codes
  std::vector<BaseFace> faces;
  std::vector<Region> regions;  ///< first_interval and interval_count are 0: each region message has its list
};
[[nodiscard]] BaseMesh base_mesh_of(const Model& model);

/// For each vertex the maximum distance of the vertices that collapse into it, in file units. `parent` is kNone for a
/// base vertex, and every chain of parents ends at one. O(vertices x depth), allocates.
[[nodiscard]] std::vector<double> collapse_distances(std::span<const std::array<float, 3>> positions,
                                                     std::span<const std::uint32_t> parent);
/// The radius code of such a distance, with a margin for the rounding errors of its computation.
[[nodiscard]] inline std::uint16_t safe_radius_code(double distance) noexcept {
  return radius_code(distance * (1 + 1e-12));
}

/// Describes the defects of a model; empty if it is sound. Checks every index, order and count that the run time uses,
/// so that a hostile file or stream causes no access out of bounds. O(size x forest depth), allocates.
[[nodiscard]] std::vector<std::string> violations(const Model& model);
[[nodiscard]] std::vector<std::string> violations(const BaseMesh& base);

/// The corners of faces by FaceId.
using ModelCorners = IdVector<FaceId, std::array<VertexId, 3>>;

/// The corners of the base mesh's faces; those of faces that a record bears are 0. Allocates.
[[nodiscard]] ModelCorners base_corners(const Model& model);

/// Applies a record to the corners after all records before it. Calls `visit` with the other two corners of each
/// deformed corner and with the third corner of each born face; a vertex may come several times.
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

/// The finest mesh as triangles by FaceId, whose corners are indices of `positions`. Applies all records in order.
/// O(size), allocates.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> finest_faces(const Model& model);
/// The base mesh as triangles in the order of `base_faces`. Allocates.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> base_triangles(const Model& model);

}  // namespace tactus::spm
