/// From the finest mesh to a base mesh by half-edge collapses u -> t, each noted so that it can be undone.
///
/// The order is greedy by quadric error: the area-weighted squared distance from t to the planes of all faces that ever
/// collapsed into u, plus planes that hold borders in place. Ties go to the smaller vertex, so a mesh has one result.
/// A collapse is legal when it keeps the surface a surface (link condition; borders shrink along themselves only; where
/// sheets touch they may come apart, but none comes to lie on another) and when every face version that it makes still
/// looks the way its finest version does and is no needle.
/// Sources: Garland, Heckbert 1997 (quadrics); Dey et al. 1999 (link condition).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct SimplifyOptions {
  std::uint32_t base_faces = 500;  ///< stop at this many faces, or when nothing legal is left
  std::uint32_t max_star = 40;     ///< faces around u, and around t afterwards unless it had more before
  double min_cosine = 0.1;         ///< between the normals of a face version and of its finest version
  double min_shape = 1e-3;  ///< 4 sqrt(3) area / sum of squared edges, 1 when equilateral; a worse face may not worsen
};

/// A face that held both u and t, and vanished.
struct DyingFace {
  std::uint32_t face;
  std::uint32_t x;     ///< its third corner
  std::uint8_t order;  ///< as in BornRef
  bool finest;         ///< no collapse had touched it before
};
/// A face whose corner went from u to t.
struct MovedCorner {
  std::uint32_t face;
  std::uint8_t corner;
  bool finest;  ///< no collapse had touched the face before
};
struct Collapse {
  std::uint32_t u, t;
  std::uint32_t first_dying, dying_count;  ///< in `Collapses::dying`
  std::uint32_t first_moved, moved_count;  ///< in `Collapses::moved`
};

struct Collapses {
  std::vector<Collapse> sequence;  ///< in the order in which they happened: the first undone last
  std::vector<DyingFace> dying;
  std::vector<MovedCorner> moved;
  std::vector<Triangle> corners;    ///< by face: in the base mesh, or when it vanished
  std::vector<std::uint8_t> alive;  ///< by face: 1 when part of the base mesh
};

/// `mesh` must be clean (see clean.hpp). `progress` gets the share done, 0 to 1, now and then.
[[nodiscard]] Collapses simplify(const TriangleMesh& mesh, const SimplifyOptions& options,
                                 const std::function<void(double)>& progress = {});

}  // namespace tactus::spm::offline
