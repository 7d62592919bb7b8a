/// From the finest mesh to a base mesh by half-edge collapses u -> t, each noted so that it can be undone.
///
/// The order is greedy by quadric error: the area-weighted squared distance from t to the planes of all faces that ever
/// collapsed into u, plus planes that hold borders in place; costs within an eighth of a power of two count as equal,
/// and who waits longest goes first. A collapse is legal when it keeps the surface a surface (link condition; borders
/// shrink along themselves only; where sheets touch they may come apart, but none comes to lie on another) and when
/// every face version that it makes still looks the way its finest version does and is no needle.
///
/// A large mesh is cut into blocks of nearby faces. In each block alone, on any thread, collapses go on between
/// vertices whose faces all belong to it until a quarter of its faces is left; then what is left is cut anew,
/// elsewhere, until it is small enough to be one block. The blocks depend on the mesh alone, so the result does too.
/// Sources: Garland, Heckbert 1997 (quadrics); Dey et al. 1999 (link condition).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"
#include "spm/record.hpp"

namespace tactus::spm::offline {

struct SimplifyOptions {
  std::uint32_t base_faces = 500;  ///< stop at this many faces, or when nothing legal is left
  std::uint32_t max_star = 40;     ///< faces around u, and around t afterwards unless it had more before
  double min_cosine = 0.1;         ///< between the normals of a face version and of its finest version
  double min_shape = 1e-3;  ///< 4 sqrt(3) area / sum of squared edges, 1 when equilateral; a worse face may not worsen
  /// File units. Vertices nearer to each other than this may contract whatever that does to the topology, with or
  /// without an edge between them: cracks and tunnels close, parts grow together. Only once the mesh is one block:
  /// before that, what keeps the surface whole does better. 0: none.
  double pair_distance = 0;
  std::uint32_t block_faces = 1u << 15;  ///< at most, in a block; part of the result as much as the mesh is
};

struct Collapse {
  std::uint32_t u, t;
  std::uint32_t first_dying, first_moved;  ///< in its segment; they end where those of the next begin
};

/// The collapses of one block, in the order in which they happened.
struct Segment {
  std::vector<Collapse> sequence;  ///< and one more, which says where the last one's faces end
  std::vector<BornRef> dying;      ///< faces that held both u and t, and vanished; `last`: none had touched it before
  std::vector<std::uint32_t> dying_x;  ///< their third corners
  std::vector<DeformedRef> moved;      ///< corners that went from u to t; `last`: none had touched the face before

  [[nodiscard]] std::uint32_t size() const noexcept {
    return sequence.empty() ? 0 : static_cast<std::uint32_t>(sequence.size() - 1);
  }
};

struct Collapses {
  std::vector<Segment> segments;    ///< as if one after the other: the first undone last
  std::vector<std::size_t> rounds;  ///< where each round begins, and the end; the segments of one share no face
  std::vector<Triangle> corners;    ///< by face: in the base mesh, or when it vanished
  std::vector<std::uint32_t> base;  ///< faces of the base mesh, ascending
  std::vector<bool> base_finest;    ///< by place in `base`: no collapse has touched it
};

/// `mesh` must be clean (see clean.hpp); it goes fastest when near faces have near numbers (face_order.hpp). `progress`
/// gets the share done, 0 to 1, now and then, in the calling thread. `threads`: 0 is all there are.
[[nodiscard]] Collapses simplify(const TriangleMesh& mesh, const SimplifyOptions& options, unsigned threads = 0,
                                 const std::function<void(double)>& progress = {});

}  // namespace tactus::spm::offline
