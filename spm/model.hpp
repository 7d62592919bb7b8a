/// A whole space-partitioned multi-resolution (SPM) model as flat arrays: what a `.spm` file holds and a VE host
/// serves.
///
/// Positions are in file units and model frame, float, exactly as imported. Everything here is in ids.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (header, base mesh, regions, vertex splits).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "spm/ids.hpp"
#include "spm/record.hpp"
#include "spm/span.hpp"

namespace tactus::spm {

using Vec3f = Eigen::Vector3f;
using Vec3d = Eigen::Vector3d;

/// A face of the base mesh: always shown in some version.
struct BaseFace {
  std::uint32_t face;                    ///< FaceId
  std::uint32_t last;                    ///< 1 when no record deforms it: it is finest as it stands
  std::array<std::uint32_t, 3> corners;  ///< VertexIds below `base_vertices`
};
static_assert(sizeof(BaseFace) == 20);

/// The even partition of the bounding volume. A cell at depth d has edge `cell_size / 2^d`; cell (x, y, z) at depth d
/// spans `origin + (x, y, z) * edge` to one edge further. Depth 0 is the regular grid; deeper cells divide dense ones.
struct GridFrame {
  std::array<double, 3> origin;
  double cell_size;
};

/// A labelled cell and the extent of its closed record list in `Model::intervals`.
struct Region {
  std::array<std::uint16_t, 3> cell;  ///< x, y, z at its depth
  std::uint16_t depth;
  /// Which sixty-fourths of the cell faces meet: bit x + 4 y + 16 z, low word first; in each axis a quarter of the
  /// edge.
  std::array<std::uint32_t, 2> occupied;
  std::uint32_t first_interval, interval_count;  ///< in `Model::intervals`
  std::uint32_t record_count;                    ///< sum of its intervals
  std::uint32_t part_count;                      ///< pool slots its records take
  std::uint32_t face_count;                      ///< finest faces that meet the cell
  std::uint32_t checksum;                        ///< of its list, see seal.hpp
};
static_assert(sizeof(Region) == 40);

/// Consecutive record ids `[first, first + count)`. A region's intervals ascend and do not touch.
struct Interval {
  std::uint32_t first, count;
};

/// What is said of a model before any of it is sent.
struct ModelSummary {
  std::uint64_t digest;  ///< XXH3-64 of all sections; two models with one digest are one model
  std::uint32_t vertices, faces;
  std::uint32_t base_vertices, base_faces;
  std::uint32_t records;  ///< = vertices - base_vertices
  std::uint32_t parts;    ///< records plus continuation parts
  std::uint32_t regions;
  std::uint32_t max_level;  ///< records that must follow one another at most: 1 + that of the deepest one needed
  std::array<float, 3> bounds_min, bounds_max;  ///< of the vertices, file units
  GridFrame grid;
  double metres_per_unit;  ///< suggested by `tactus-mesh build`; a host may override it for an object
  /// File units. No point of any version of the mesh is further than this from its place on the finest, nor the
  /// reverse: the greatest radius of a vertex, which bounds what the face between three moves.
  double deviation;
  /// File units. 0: positions are floats as imported (lossless profile). Above: each coordinate is the float nearest to
  /// `bounds_min` plus a whole number of these, below 2^24 (compact profile).
  double position_step;
};

/// Borrowed view of a model; whoever made it (a mapped file, a builder) must outlive it.
struct Model {
  ModelSummary summary;
  Span<const std::array<float, 3>> positions;  ///< by VertexId
  Span<const std::uint16_t> base_radii;        ///< by VertexId below `base_vertices`: codes, see record.hpp
  Span<const BaseFace> base_faces;
  Span<const RecordPart> parts;  ///< part r < records is record r's first; continuation parts follow
  Span<const Region> regions;
  Span<const Interval> intervals;

  [[nodiscard]] Span<const Interval> intervals_of(RegionId region) const noexcept {
    const Region& r = regions[index(region)];
    return intervals.subspan(r.first_interval, r.interval_count);
  }
  [[nodiscard]] VertexId vertex_of(RecordId record) const noexcept {
    return VertexId{summary.base_vertices + index(record)};
  }
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

  [[nodiscard]] Model model() const { return {summary, positions, base_radii, base_faces, parts, regions, intervals}; }
};

/// Everything a controller needs of a model before its first record: the base mesh and the labelled cells.
struct BaseMesh {
  ModelSummary summary;
  std::vector<std::array<float, 3>> positions;  ///< `base_vertices` of them
  std::vector<std::uint16_t> radii;             ///< theirs, as codes
  std::vector<BaseFace> faces;
  std::vector<Region> regions;  ///< first_interval and interval_count are 0: lists come with the regions
};
[[nodiscard]] BaseMesh base_mesh_of(const Model& model);

/// By vertex: the greatest distance from any that collapses into it, in file units. `parent` has kNone for a base
/// vertex; every way up ends at one. O(vertices x depth), allocates.
[[nodiscard]] std::vector<double> collapse_distances(Span<const std::array<float, 3>> positions,
                                                     Span<const std::uint32_t> parent);
/// Such a distance as a radius code that rounding in its computation cannot have made too small.
[[nodiscard]] inline std::uint16_t safe_radius_code(double distance) noexcept {
  return radius_code(distance * (1 + 1e-12));
}

/// What is broken in a model, in words; empty when sound. Checks every index, order and count that the run time relies
/// on, so that a hostile file or stream cannot lead it out of its arrays. O(size x forest depth), allocates.
[[nodiscard]] std::vector<std::string> violations(const Model& model);
[[nodiscard]] std::vector<std::string> violations(const BaseMesh& base);

/// The corners of the base mesh's faces, by FaceId, as VertexIds; those of faces that a record bears are 0. Allocates.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> base_corners(const Model& model);

/// Applies record `r` to the corners that all before it have left; `met` gets each corner beside the new vertex or its
/// parent, in faces moved over and in faces born, some of them several times.
template <class Met>
void apply_record(const Model& model, std::uint32_t r, std::vector<std::array<std::uint32_t, 3>>& corners, Met met) {
  const std::uint32_t u = model.summary.base_vertices + r;
  for (std::uint32_t p = r; p != kNone; p = model.parts[p].next) {
    const RecordPart& part = model.parts[p];
    for (int i = 0; i < part.deformed_count; ++i) {
      const std::uint32_t corner = part.deformed[i].corner();
      std::array<std::uint32_t, 3>& face = corners[part.deformed[i].face()];
      met(face[(corner + 1) % 3]);
      met(face[(corner + 2) % 3]);
      face[corner] = u;
    }
    for (int i = 0; i < part.born_count; ++i) {
      const BornCorners at = born_corners(part.born[i].order());
      std::array<std::uint32_t, 3>& face = corners[part.born[i].face()];
      face[static_cast<std::size_t>(at.u)] = u;
      face[static_cast<std::size_t>(at.t)] = part.parent;
      face[static_cast<std::size_t>(at.x)] = part.born_x[i];
      met(part.born_x[i]);
    }
  }
}

/// The corners of every finest face, by FaceId, as VertexIds: all records applied in order. O(size), allocates.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> finest_faces(const Model& model);

}  // namespace tactus::spm
