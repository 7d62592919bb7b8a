/// One vertex-split record: the change of the mesh when a removed vertex returns. 64 bytes a part.
///
///          x0                    x0           split(u): adds u next to t.
///         /  \                  /| \          born:     the new faces with both u and t (2, at a border 1).
///        /    \   split(u)     / |  \         deformed: the faces around t in which u replaces t.
///   ----t------    ----->  ---t--u----        collapse(u): writes t back at the same corners, to the bit.
///        \    /                \ |  /
///         x1                    x1            Every vertex that is ever shown is a vertex of the finest mesh.
///
/// A record is a chain of one or more parts. Most records have one part. A vertex of high valence or on a non-manifold
/// edge has more, each with further faces. File and memory have the same layout, with ids in the file and slots in
/// memory; RecordDecoder turns the first into the second.
/// Source: Hoppe 1996 (vertex split); De Floriani, Magillo, Puppo 1997 (legality, see offline/closure.hpp).
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "spm/ids.hpp"

namespace tactus::spm {

inline constexpr int kBornPerPart = 2;
inline constexpr int kDeformedPerPart = 9;
/// One bit of a vertex reference is reserved; see kInRing in region_data.hpp.
inline constexpr std::uint32_t kMaxVertices = 1u << 31;
/// A face reference shares its 32 bits with a corner and a flag.
inline constexpr std::uint32_t kMaxFaces = 1u << 28;

/// The corners of u, t and x in a born face: u is at corner `order / 2`, t at the next corner if `order` is even and at
/// the previous one if it is odd, x at the remaining corner.
struct BornCorners {
  int u, t, x;
};
[[nodiscard]] constexpr BornCorners born_corners(std::uint32_t order) noexcept {
  const int u = static_cast<int>(order / 2);
  const int next = (u + 1) % 3;
  const int before = (u + 2) % 3;
  return order % 2 == 0 ? BornCorners{u, next, before} : BornCorners{u, before, next};
}
template <class Vertex>
[[nodiscard]] constexpr std::array<Vertex, 3> born_face(std::uint32_t order, Vertex u, Vertex t, Vertex x) noexcept {
  const BornCorners at = born_corners(order);
  std::array<Vertex, 3> corners{};
  corners[static_cast<std::size_t>(at.u)] = u;
  corners[static_cast<std::size_t>(at.t)] = t;
  corners[static_cast<std::size_t>(at.x)] = x;
  return corners;
}

/// A born face: `face << 4 | order << 1 | last`; `last`: this is the finest version of the face.
struct BornRef {
  std::uint32_t bits;
  [[nodiscard]] static constexpr BornRef make(FaceId face, std::uint32_t order, bool last) noexcept {
    return {index(face) << 4 | order << 1 | static_cast<std::uint32_t>(last)};
  }
  [[nodiscard]] constexpr FaceId face() const noexcept { return FaceId{bits >> 4}; }
  [[nodiscard]] constexpr std::uint32_t order() const noexcept { return bits >> 1 & 7u; }
  [[nodiscard]] constexpr bool last() const noexcept { return (bits & 1u) != 0; }
};

/// A deformed corner: `face << 3 | corner << 1 | last`. In a file `Face` is FaceId, in memory RowIndex.
template <class Face>
struct BasicDeformedRef {
  std::uint32_t bits;
  [[nodiscard]] static constexpr BasicDeformedRef make(Face face, std::uint32_t corner, bool last) noexcept {
    return {index(face) << 3 | corner << 1 | static_cast<std::uint32_t>(last)};
  }
  [[nodiscard]] constexpr Face face() const noexcept { return Face{bits >> 3}; }
  [[nodiscard]] constexpr std::uint32_t corner() const noexcept { return bits >> 1 & 3u; }
  [[nodiscard]] constexpr bool last() const noexcept { return (bits & 1u) != 0; }
};

/// The radius of a vertex is an upper bound of its distance to each vertex that collapses into it, over any number of
/// steps. Its code is the upper half of a float with four bits of fraction, rounded up. The code is 0 if no vertex
/// collapses into it, monotone, and at most 6.25 % above the distance (more below 1e-38).
inline constexpr std::uint16_t kRadiusCodes = 0xff0;  ///< codes below are finite

/// File units. `code` is below kRadiusCodes.
[[nodiscard]] inline float radius_of(std::uint16_t code) noexcept {
  const std::uint32_t bits = std::uint32_t{code} << 19;
  float radius;
  std::memcpy(&radius, &bits, sizeof radius);
  return radius;
}
/// The smallest code whose radius is at least `distance`, or kRadiusCodes. `distance` is not negative.
[[nodiscard]] inline std::uint16_t radius_code(double distance) noexcept {
  if (!(distance <= std::numeric_limits<float>::max())) return kRadiusCodes;
  auto rounded = static_cast<float>(distance);
  if (rounded < distance) rounded = std::nextafter(rounded, std::numeric_limits<float>::infinity());
  std::uint32_t bits;
  std::memcpy(&bits, &rounded, sizeof bits);
  return static_cast<std::uint16_t>((bits + 0x7ffffu) >> 19);
}

/// `Vertex`, `Face`, `Part`: the index types of vertices, deformed faces and parts.
template <class Vertex, class Face, class Part>
struct alignas(64) BasicRecordPart {
  using DeformedRef = BasicDeformedRef<Face>;
  Vertex parent;                ///< t; the same in every part of a chain
  Part next;                    ///< kNone ends the chain
  std::uint8_t born_count;      ///< of this part, at most kBornPerPart
  std::uint8_t deformed_count;  ///< of this part, at most kDeformedPerPart
  std::uint16_t radius;         ///< of u, as a code; the same in every part of a chain
  BornRef born[kBornPerPart];   ///< always FaceIds
  Vertex born_x[kBornPerPart];  ///< the third corner
  DeformedRef deformed[kDeformedPerPart];
};
/// In a file or message, and in the pool.
using RecordPart = BasicRecordPart<VertexId, FaceId, PartIndex>;
using LoadedPart = BasicRecordPart<Slot, RowIndex, Slot>;
using DeformedRef = RecordPart::DeformedRef;
static_assert(sizeof(RecordPart) == 64 && sizeof(LoadedPart) == 64);

/// Visits the changes of the split of `u`, whose record starts with part `first` of `parts`: `deform(ref)` for each
/// deformed corner, which moves from t to u, and `bear(ref, corners, part, i)` for face `i` that `part` bears. Every
/// split of a mesh goes through here, whatever stores the mesh. The changes touch different faces, so their order is
/// free.
template <class Parts, class Part, class Vertex, class Deform, class Bear>
void for_each_change(const Parts& parts, Part first, Vertex u, Deform&& deform, Bear&& bear) {
  for (Part at = first; at != kNone; at = parts[at].next) {
    const auto& part = parts[at];
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) deform(part.deformed[i]);
    for (std::uint32_t i = 0; i < part.born_count; ++i)
      bear(part.born[i], born_face(part.born[i].order(), u, part.parent, part.born_x[i]), at, i);
  }
}

}  // namespace tactus::spm
