/// One vertex split, 64 bytes: what changes in the mesh when a removed vertex comes back.
///
///          x0                    x0           split(u): u appears beside t;
///         /  \                  /| \          born:     the faces that hold both u and t (2, at a border 1);
///        /    \   split(u)     / |  \         deformed: the faces around t that now have u where they had t.
///   ----t------    ----->  ---t--u----        collapse(u) writes t back in the same places: the identity, to the bit.
///        \    /                \ |  /
///         x1                    x1            Every vertex ever shown is a vertex of the finest mesh.
///
/// A record is a chain of one or more parts. Nearly all have one; a vertex of high valence or on a non-manifold edge
/// has more, each with further faces. The same layout serves the file (ids), and memory (slots); Cache::decode is the
/// one place that turns the first into the second. Source: Hoppe 1996 (vertex split); De Floriani, Magillo, Puppo 1997
/// (legality, see offline/closure.hpp).
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "spm/ids.hpp"

namespace tactus::spm {

inline constexpr int kBornPerPart = 2;
inline constexpr int kDeformedPerPart = 9;
/// What names a vertex has one bit to spare.
inline constexpr std::uint32_t kMaxVertices = 1u << 31;
/// A face reference shares its 32 bits with a corner and a flag.
inline constexpr std::uint32_t kMaxFaces = 1u << 28;

/// Where u, t and x stand in a born face: u at corner `order / 2`, t at the next corner when `order` is even and at the
/// one before when it is odd, x at the remaining corner.
struct BornCorners {
  int u, t, x;
};
[[nodiscard]] constexpr BornCorners born_corners(std::uint32_t order) noexcept {
  const int u = static_cast<int>(order / 2);
  const int next = (u + 1) % 3;
  const int before = (u + 2) % 3;
  return order % 2 == 0 ? BornCorners{u, next, before} : BornCorners{u, before, next};
}

/// A born face: `face << 4 | order << 1 | last`; `last` says that this is the finest version of the face.
struct BornRef {
  std::uint32_t bits;
  [[nodiscard]] static constexpr BornRef make(std::uint32_t face, std::uint32_t order, bool last) noexcept {
    return {face << 4 | order << 1 | static_cast<std::uint32_t>(last)};
  }
  [[nodiscard]] constexpr std::uint32_t face() const noexcept { return bits >> 4; }
  [[nodiscard]] constexpr std::uint32_t order() const noexcept { return bits >> 1 & 7u; }
  [[nodiscard]] constexpr bool last() const noexcept { return (bits & 1u) != 0; }
};

/// A deformed corner: `face << 3 | corner << 1 | last`. In a file `face` is a FaceId, in memory a face slot.
struct DeformedRef {
  std::uint32_t bits;
  [[nodiscard]] static constexpr DeformedRef make(std::uint32_t face, std::uint32_t corner, bool last) noexcept {
    return {face << 3 | corner << 1 | static_cast<std::uint32_t>(last)};
  }
  [[nodiscard]] constexpr std::uint32_t face() const noexcept { return bits >> 3; }
  [[nodiscard]] constexpr std::uint32_t corner() const noexcept { return bits >> 1 & 3u; }
  [[nodiscard]] constexpr bool last() const noexcept { return (bits & 1u) != 0; }
};

/// A vertex's radius: no vertex of the finest mesh that collapses into it, over any number of steps, is further from
/// it. Its code is the upper half of a float with four bits of fraction, rounded up: 0 for a vertex into which none
/// collapses, monotone, at most 6.25 % above the distance (further below 1e-38).
inline constexpr std::uint16_t kRadiusCodes = 0xff0;  ///< codes below are finite

/// File units. `code` is below kRadiusCodes.
[[nodiscard]] inline float radius_of(std::uint16_t code) noexcept {
  const std::uint32_t bits = std::uint32_t{code} << 19;
  float radius;
  std::memcpy(&radius, &bits, sizeof radius);
  return radius;
}
/// The smallest code whose radius is at least `distance`; kRadiusCodes when there is none. `distance` is not negative.
[[nodiscard]] inline std::uint16_t radius_code(double distance) noexcept {
  if (!(distance <= std::numeric_limits<float>::max())) return kRadiusCodes;
  auto rounded = static_cast<float>(distance);
  if (rounded < distance) rounded = std::nextafter(rounded, std::numeric_limits<float>::infinity());
  std::uint32_t bits;
  std::memcpy(&bits, &rounded, sizeof bits);
  return static_cast<std::uint16_t>((bits + 0x7ffffu) >> 19);
}

struct alignas(64) RecordPart {
  std::uint32_t parent;         ///< t: VertexId in a file, Slot in memory; the same in every part of a chain
  std::uint32_t next;           ///< next part: index into the part array (file) or Slot (memory); kNone ends the chain
  std::uint8_t born_count;      ///< of this part, at most kBornPerPart
  std::uint8_t deformed_count;  ///< of this part, at most kDeformedPerPart
  std::uint16_t radius;         ///< of u, as a code; the same in every part of a chain
  BornRef born[kBornPerPart];   ///< always FaceIds
  std::uint32_t born_x[kBornPerPart];  ///< the third corner: VertexId in a file, Slot in memory
  DeformedRef deformed[kDeformedPerPart];
};
static_assert(sizeof(RecordPart) == 64);

}  // namespace tactus::spm
