/// Simplifies the finest mesh to a base mesh by half-edge collapses u -> t, which are recorded so that they can be
/// undone.
///
/// The order is greedy by quadric error: the area-weighted squared distance from t to the planes of all faces that ever
/// collapsed into u, plus planes that hold borders in position. Costs within an eighth of a power of two count as
/// equal; among these, the vertex that waits longest comes first.
///
/// A collapse is legal if the result is a surface and looks like the finest mesh. That means: the link condition holds;
/// a border only shrinks along itself; sheets that touch may separate, but no face coincides with another; and every
/// new face version has nearly the normal of its finest version and is no needle.
///
/// A large mesh is cut into blocks of nearby faces. Each block is simplified alone, on any thread, to a quarter of its
/// faces; only vertices with all their faces in the block take part. Then the rest is cut at other positions, until it
/// is one block. The blocks depend on the mesh alone, so the result does not depend on the threads. Sources: Garland,
/// Heckbert 1997 (quadrics); Dey et al. 1999 (link condition).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"
#include "spm/record.hpp"

namespace tactus::spm::offline {

struct SimplifyOptions {
  std::uint32_t base_faces = 500;  ///< stops at this number of faces, or if no collapse is legal
  std::uint32_t max_star = 40;     ///< max faces around u, and around t after the collapse unless it had more before
  double min_cosine = 0.1;         ///< between the normals of a face version and of its finest version
  double min_shape = 1e-3;  ///< 4 sqrt(3) area / sum of squared edges, 1 if equilateral; no face below may get worse
  /// File units. Vertices within this distance may collapse with or without an edge between them, even if the topology
  /// changes: cracks and tunnels close, parts merge. Applies only to the last round, when the mesh is one block. 0:
  /// none.
  double pair_distance = 0;
  std::uint32_t block_faces = 1u << 15;  ///< max faces of a block; affects the result
};

struct Collapse {
  std::uint32_t u, t;
  std::uint32_t first_dying, first_moved;  ///< in its segment; the next collapse has the end
};

/// The collapses of one block, in order.
struct Segment {
  std::vector<Collapse> sequence;      ///< and a last entry with the ends of the faces
  std::vector<BornRef> dying;          ///< removed faces, with u and t; `last`: no earlier collapse changed the face
  std::vector<std::uint32_t> dying_x;  ///< their third corners
  std::vector<DeformedRef> moved;      ///< corners moved from u to t; `last`: no earlier collapse changed the face

  [[nodiscard]] std::uint32_t size() const noexcept {
    return sequence.empty() ? 0 : static_cast<std::uint32_t>(sequence.size() - 1);
  }
};

struct Collapses {
  std::vector<Segment> segments;    ///< in order
  std::vector<std::size_t> rounds;  ///< first segment of each round, and the end; segments of one round share no face
  std::vector<Triangle> corners;    ///< by face: in the base mesh, or when it was removed
  std::vector<std::uint32_t> base;  ///< faces of the base mesh, ascending
  std::vector<bool> base_finest;    ///< by position in `base`: no collapse has changed the face
};

/// `mesh` must be clean (clean.hpp). Fastest if neighbouring faces have neighbouring numbers (face_order.hpp). Calls
/// `progress` with the finished share, 0 to 1, in the calling thread. `threads`: 0: all processors.
[[nodiscard]] Collapses simplify(const TriangleMesh& mesh, const SimplifyOptions& options, unsigned threads = 0,
                                 const std::function<void(double)>& progress = {});

}  // namespace tactus::spm::offline
