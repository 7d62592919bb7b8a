/// A vertex-split record: the data by which a split adds one vertex, u, next to its parent vertex, t.
///
///          x0                    x0           born faces:     the new faces with both u and t (2; 1 at a border).
///         /  \                  /| \          deformed faces: the faces around t in which u replaces t.
///        /    \   split(u)     / |  \         collapse(u):    writes t back at the same corners, to the bit.
///   ----t------    ----->  ---t--u----
///        \    /                \ |  /         Every vertex of every version is a vertex of the finest mesh.
///         x1                    x1
///
/// A record is a chain of one or more parts of 64 bytes. Most records have one part. If u has many faces or is on a
/// non-manifold edge, the record has further parts with further faces. Parts have ids where a model is built, decoded
/// or encoded, and slots and rows in the pool; only born faces keep their ids. RecordDecoder converts them.
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
/// Max number of born and deformed faces of a record. A cycle applies a record as a whole.
inline constexpr std::uint32_t kMaxChanges = 256;
/// One bit of a vertex reference is reserved, see kInRing in region_data.hpp.
inline constexpr std::uint32_t kMaxVertices = 1u << 31;
/// A reference to a face shares 32 bits with two flags or with the number of a corner.
inline constexpr std::uint32_t kMaxFaces = 1u << 30;

/// The corners of a born face: u, then t and the third vertex x if `order` is 0, or x and t if it is 1.
template <class Vertex>
[[nodiscard]] constexpr std::array<Vertex, 3> born_face(std::uint32_t order, Vertex u, Vertex t, Vertex x) noexcept {
  return order == 0 ? std::array<Vertex, 3>{u, t, x} : std::array<Vertex, 3>{u, x, t};
}

/// The corner numbers of t and x in a born face. u is at corner 0.
[[nodiscard]] constexpr std::uint32_t corner_of_t(std::uint32_t order) noexcept { return 1 + order; }
[[nodiscard]] constexpr std::uint32_t corner_of_x(std::uint32_t order) noexcept { return 2 - order; }

/// A born face: `face << 2 | order << 1 | is_finest`. `is_finest` states whether no later record deforms the face.
struct BornRef {
  std::uint32_t bits;
  [[nodiscard]] static constexpr BornRef make(FaceId face, std::uint32_t order, bool is_finest) noexcept {
    return {index(face) << 2 | order << 1 | static_cast<std::uint32_t>(is_finest)};
  }
  [[nodiscard]] constexpr FaceId face() const noexcept { return FaceId{bits >> 2}; }
  [[nodiscard]] constexpr std::uint32_t order() const noexcept { return bits >> 1 & 1u; }
  [[nodiscard]] constexpr bool is_finest() const noexcept { return (bits & 1u) != 0; }
};

/// A deformed corner: the corner of `face` at which u replaces t. `is_finest` as for BornRef. `Face` is FaceId in a
/// file and RowIndex in memory.
template <class Face>
class BasicDeformedRef {
 public:
  [[nodiscard]] static constexpr BasicDeformedRef make(Face face, std::uint32_t corner, bool is_finest) noexcept {
    return {face, corner, is_finest};
  }
  [[nodiscard]] constexpr Face face() const noexcept { return face_; }
  [[nodiscard]] constexpr std::uint32_t corner() const noexcept { return corner_; }
  [[nodiscard]] constexpr bool is_finest() const noexcept { return is_finest_; }
  friend constexpr bool operator==(const BasicDeformedRef&, const BasicDeformedRef&) noexcept = default;

 private:
  constexpr BasicDeformedRef(Face face, std::uint32_t corner, bool is_finest) noexcept
      : face_{face}, corner_{static_cast<std::uint8_t>(corner)}, is_finest_{is_finest} {}
  Face face_;
  std::uint8_t corner_;
  bool is_finest_;
};

/// The radius of a vertex is an upper bound of its distance from each vertex that collapses into it, over any number of
/// steps. The radius code consists of exponent and upper four bits of fraction of a float, rounded up. The code is
/// monotone, and 0 if no vertex collapses into the vertex. The radius exceeds the distance by at most 6.25 % (by more
/// below 1e-38). Codes below kRadiusCodes are finite.
inline constexpr std::uint16_t kRadiusCodes = 0xff0;

/// Returns the radius in file units. `code` is below kRadiusCodes.
[[nodiscard]] inline float radius_of(std::uint16_t code) noexcept {
  const std::uint32_t bits = std::uint32_t{code} << 19;
  float radius;
  std::memcpy(&radius, &bits, sizeof radius);
  return radius;
}
/// Returns the smallest code whose radius is at least `distance`; kRadiusCodes if there is none. `distance` must not be
/// negative.
[[nodiscard]] inline std::uint16_t radius_code(double distance) noexcept {
  if (!(distance <= std::numeric_limits<float>::max())) return kRadiusCodes;
  auto rounded = static_cast<float>(distance);
  if (rounded < distance) rounded = std::nextafter(rounded, std::numeric_limits<float>::infinity());
  std::uint32_t bits;
  std::memcpy(&bits, &rounded, sizeof bits);
  return static_cast<std::uint16_t>((bits + 0x7ffffu) >> 19);
}

/// One part of a record. `Vertex`, `Face` and `Part` are the index types of vertices, deformed faces and parts.
template <class Vertex, class Face, class Part>
struct alignas(64) BasicRecordPart {
  using DeformedRef = BasicDeformedRef<Face>;
  Vertex parent;                                     ///< t; the same in every part of a record
  Part next;                                         ///< next part of the record, or kNone
  std::uint16_t born_count : 2;                      ///< born faces in this part, at most kBornPerPart
  std::uint16_t deformed_count : 4;                  ///< deformed faces in this part, at most kDeformedPerPart
  std::uint16_t finest : kDeformedPerPart;           ///< bit i: deformed face i is in its finest version
  std::uint16_t unused : 1;                          ///< 0, as the digest covers all bits of a part
  std::uint16_t radius;                              ///< radius code of u; the same in every part of a record
  BornRef born[kBornPerPart];                        ///< born faces, by FaceId also in memory
  Vertex born_x[kBornPerPart];                       ///< x, the third corner, of each born face
  std::uint32_t deformed_corners[kDeformedPerPart];  ///< `face << 2 | corner` of each deformed face

  [[nodiscard]] DeformedRef deformed(std::uint32_t i) const noexcept {
    return DeformedRef::make(Face{deformed_corners[i] >> 2}, deformed_corners[i] & 3u, (finest >> i & 1u) != 0);
  }
  void set_deformed(std::uint32_t i, DeformedRef ref) noexcept {
    deformed_corners[i] = index(ref.face()) << 2 | ref.corner();
    finest = ((finest & ~(1u << i)) | std::uint32_t{ref.is_finest()} << i) & ((1u << kDeformedPerPart) - 1);
  }
  /// `deformed_count` must be below kDeformedPerPart.
  void add_deformed(DeformedRef ref) noexcept {
    set_deformed(deformed_count, ref);
    ++deformed_count;
  }
};
/// A part in a file or message.
using RecordPart = BasicRecordPart<VertexId, FaceId, PartIndex>;
/// A part in the pool.
using LoadedPart = BasicRecordPart<Slot, RowIndex, Slot>;
using DeformedRef = RecordPart::DeformedRef;
static_assert(BornRef::make(FaceId{kMaxFaces - 1}, 1, true).face() == FaceId{kMaxFaces - 1});
static_assert(sizeof(RecordPart) == 64 && sizeof(LoadedPart) == 64);

/// Visits the changes of the split of `u`, whose record starts with part `first` of `parts`. Calls `deform(ref)` for
/// each deformed corner, which moves from t to u, and `add_born_face(ref, corners, part, i)` for born face `i` of
/// `part`. All code that applies checked records uses this function, whatever stores the mesh. The changes concern
/// different faces, so they can be applied in any order.
template <class Parts, class Part, class Vertex, class Deform, class AddBornFace>
void for_each_change(const Parts& parts, Part first, Vertex u, Deform&& deform, AddBornFace&& add_born_face) {
  for (Part at = first; at != kNone; at = parts[at].next) {
    const auto& part = parts[at];
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) deform(part.deformed(i));
    for (std::uint32_t i = 0; i < part.born_count; ++i)
      add_born_face(part.born[i], born_face(part.born[i].order(), u, part.parent, part.born_x[i]), at, i);
  }
}

}  // namespace tactus::spm
