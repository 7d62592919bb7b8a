/// Simplifies the finest mesh to a base mesh by half-edge collapses u -> t. Returns the collapses with all that is
/// needed to undo them.
///
/// The cheapest collapse comes first. Its cost is the quadric error: a sum of squared distances from t to planes. The
/// sum has the planes of the finest faces around u and around all vertices that have collapsed into u, weighted by
/// area. Further planes hold borders in position. Costs are compared in classes: eight from each power of two to the
/// next. Within a class, the vertex that waits longest comes first.
///
/// A collapse is legal under these conditions. The link condition holds. A border vertex moves only along the border.
/// Sheets that touch may separate, but no face coincides with another. Each new version of a face has nearly the normal
/// of the finest version and is no needle (SimplifyOptions).
///
/// A large mesh is simplified in rounds. Each round cuts the mesh into blocks of nearby faces, at other positions than
/// the round before. Each block is simplified alone, on any thread, to a quarter of its faces. Only vertices with all
/// their faces in the block take part. The last round has a single block. The blocks depend on the mesh alone, so the
/// result does not depend on the number of threads.
///
/// With SimplifyOptions::tile_faces, the mesh is also cut into tiles, and each block of the first three rounds lies in
/// one tile. So the vertices of several tiles stay until a tile has a 64th of its faces, and until then tiles do not
/// depend on each other.
/// Sources: Garland, Heckbert 1997 (quadrics); Dey et al. 1999 (link condition).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"
#include "spm/record.hpp"

namespace tactus::spm::offline {

struct SimplifyOptions {
  std::uint32_t base_faces = 500;  ///< simplification stops at this number of faces, or if no collapse is legal
  /// Maximum number of faces around u, and around t after the collapse. If t already has more faces, a collapse must
  /// not increase their number.
  std::uint32_t max_star = 40;
  double min_cosine = 0.1;  ///< minimum cosine of the angle between the normals of a new and of the finest version
  /// Minimum of 4 sqrt(3) area / (sum of squared edges), which is 1 for an equilateral triangle. A face below the
  /// minimum may change if this number does not decrease.
  double min_shape = 1e-3;
  /// Vertices within this distance may collapse with or without an edge between them, even if the topology changes:
  /// cracks and tunnels close, parts merge. Applies to the last round only. File units; 0: no such collapse.
  double pair_distance = 0;
  std::uint32_t block_faces = 1u << 15;  ///< maximum number of faces of a block; affects the result
  /// Number of successive faces that make a tile; 0: the mesh is one tile. With a power of two and the faces in the
  /// order of face_order.hpp, tiles are compact. Affects the result.
  std::uint32_t tile_faces = 0;
};

struct Collapse {
  std::uint32_t u, t;
  // Index of its first face in Segment::removed_faces and in Segment::moved. Its faces end where those of the next collapse
  // begin.
  std::uint32_t first_dying, first_moved;
};

/// A corner that a collapse moves from u to t, packed into 4 bytes.
class MovedCorner {
 public:
  /// `is_finest`: no earlier collapse changed the face.
  MovedCorner(std::uint32_t face, bool is_finest) noexcept : bits_{face << 3 | static_cast<std::uint32_t>(is_finest)} {}
  [[nodiscard]] std::uint32_t face() const noexcept { return bits_ >> 3; }
  /// The number of the corner in the face; dependencies() sets it.
  [[nodiscard]] std::uint32_t corner() const noexcept { return bits_ >> 1 & 3u; }
  [[nodiscard]] bool is_finest() const noexcept { return (bits_ & 1u) != 0; }
  void set_corner(std::uint32_t corner) noexcept { bits_ = (bits_ & ~6u) | corner << 1; }

 private:
  static_assert(kMaxBuiltFaces <= 1u << 29);
  std::uint32_t bits_;
};

/// The collapses of one block, in order.
struct Segment {
  std::vector<Collapse> sequence;  ///< the collapses; the last entry has only the ends of `removed_faces` and `moved`
  /// The faces that a collapse removes; finest if no earlier collapse changed the face.
  std::vector<BornRef> removed_faces;
  std::vector<std::uint32_t> removed_third_corners;  ///< third corner of each removed face, besides u and t
  std::vector<MovedCorner> moved;

  /// Number of collapses.
  [[nodiscard]] std::uint32_t size() const noexcept {
    return sequence.empty() ? 0 : static_cast<std::uint32_t>(sequence.size() - 1);
  }
};

/// All collapses of a simplification, in order.
struct Collapses {
  std::vector<Segment> segments;    ///< those of one round share no face
  std::vector<std::size_t> rounds;  ///< first segment of each round; last: number of segments
  std::vector<Triangle> corners;    ///< by face: its last version, in the base mesh or when it was removed
  std::vector<std::uint32_t> base;  ///< faces of the base mesh, ascending
  std::vector<bool> base_finest;    ///< by index in `base`: no collapse has changed the face
};

/// Simplifies a clean mesh (clean.hpp). It is fastest if neighbours in space have close face numbers (face_order.hpp).
/// Calls `progress` with the finished share, 0 to 1, in the calling thread. `threads`: 0: one per processor.
[[nodiscard]] Collapses simplify(const TriangleMesh& mesh, const SimplifyOptions& options, unsigned threads = 0,
                                 const std::function<void(double)>& progress = {});

}  // namespace tactus::spm::offline
