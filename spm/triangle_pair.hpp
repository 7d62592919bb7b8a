/// Two triangles: whether they meet, exactly, and where, along what and how deep.
///
/// A triangle of the object, abc, against one of a probe, pqr, in one frame; any unit. Both are closed: sharing one
/// point is meeting, in a corner, along an edge or in a common plane too. Decided exactly for the coordinates as they
/// are given (see orientation.hpp). A triangle without area, that is with collinear corners, meets nothing: what it
/// covers belongs to its neighbours as well. Realtime: no allocation, no lock; about 40 ns, microseconds where points
/// of one triangle lie as good as in the plane of the other.
#pragma once

#include <array>
#include <cstdint>

#include "spm/model.hpp"
#include "spm/simd.hpp"

namespace tactus::spm {

using Triangle3d = std::array<Vec3d, 3>;

struct PairContact {
  /// Middle of the segment in which they meet: mean of the points where an edge of one pierces the other. In a common
  /// plane: mean of the corners of each in the other and of the crossings of their edges.
  Vec3d point;
  /// Unit normal of the object's triangle, to the side from which its corners run counter-clockwise: from the object
  /// to the probe.
  Vec3d normal;
  /// How far the probe's triangle must move along `normal` until the two no longer meet: how deep it reaches below
  /// the object's triangle, of all that is straight above or below that triangle. 0 when they only touch from above.
  double depth;
};

/// True when they meet; then `contact` is set. Position and depth to rounding, the decision exact.
[[nodiscard]] bool meet(const Triangle3d& object, const Triangle3d& probe, PairContact& contact) noexcept;

/// Eight pairs side by side: [corner][axis][lane].
struct alignas(64) TrianglePairs {
  static constexpr int kWidth = 8;
  double object[3][3][kWidth], probe[3][3][kWidth];
};

/// The contacts of eight pairs, by lane; those of pairs that do not meet mean nothing.
struct alignas(64) PairContacts {
  double point[3][TrianglePairs::kWidth], normal[3][TrianglePairs::kWidth], depth[TrianglePairs::kWidth];
};

/// One bit for each of the first `count` pairs that meet. The same to the bit as `meet` pair by pair, for every `simd`.
[[nodiscard]] unsigned meet(const TrianglePairs& pairs, unsigned count, PairContacts& contacts, Simd simd) noexcept;

}  // namespace tactus::spm
