/// A corner table of the mesh at the loaded front: the corners of each face after all loaded records, and for each edge
/// the opposite corner across it.
///
///         g                     g            A split inserts each born face into an edge (t, x), between the deformed
///     t--------x            t--------x       face f and the face g across the edge. Two independent splits insert
///      \  f   /   split      \  born/ \      their faces on different sides of the same neighbours, so the result does
///       \    /    ----->      \    / f \     not depend on their order. Taking a face out links its two neighbours.
///        \  /                  \  /______\    u: the new vertex
///                               u
///
/// So the faces that an absent record deforms are neighbours at every receiver, as they were at the encoder, whatever
/// other records are loaded. An edge with three faces, or with two faces of opposite orientation, has no opposite; the
/// encoder does not rely on it.
/// Source: Rossignac, Safonova, Szymczak 2001 (corner table: opposite, swing).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/ids.hpp"
#include "spm/model.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

/// `Face`, `Vertex`: RowIndex and Slot in the cache, FaceId and VertexId elsewhere.
template <class Face, class Vertex>
class LoadedFront {
 public:
  using Corners = std::array<Vertex, 3>;
  /// A corner of a face; also names the edge opposite to it.
  struct At {
    Face face;
    std::uint32_t corner;
  };

  static constexpr std::size_t kBytesPerFace = 24;

  explicit LoadedFront(std::size_t faces) : faces_(faces, Entry{kNowhere, kNoLinks}) {}

  [[nodiscard]] Corners& corners(Face face) noexcept { return faces_[face].corners; }
  [[nodiscard]] const Corners& corners(Face face) const noexcept { return faces_[face].corners; }

  /// Sets the corners of a face and removes its links.
  void set(Face face, const Corners& corners) noexcept { faces_[face] = {corners, kNoLinks}; }
  /// Links the faces, which have been set, across their common edges. O(n log n), allocates.
  void link(std::span<const Face> faces);

  /// Moves `at` to the next face around its vertex, counter-clockwise seen from outside. False if there is none.
  [[nodiscard]] bool swing(At& at) const noexcept {
    const std::uint32_t opposite = faces_[at.face].opposite[after(at.corner)];
    if (opposite == kNone) return false;
    at = {Face{opposite >> 2}, after(opposite & 3u)};
    return true;
  }

  /// The faces of one split. If there are more than fit, `join` links none.
  class Split {
   public:
    static constexpr std::uint32_t kMaxDeformed = 32, kMaxBorn = 4;
    /// `at`: the corner at which u is now.
    void deform(At at) noexcept {
      if (deformed_count_++ < kMaxDeformed) deformed_[deformed_count_ - 1] = at;
    }
    void bear(Face face, std::uint32_t order) noexcept {
      if (born_count_++ < kMaxBorn) born_[born_count_ - 1] = {face, born_corners(order), order % 2 == 0};
    }

   private:
    friend class LoadedFront;
    struct Born {
      Face face;
      BornCorners at;
      bool even;  // x precedes u, so the edge between them goes from x to u
    };
    std::uint32_t deformed_count_ = 0, born_count_ = 0;
    std::array<At, kMaxDeformed> deformed_;
    std::array<Born, kMaxBorn> born_;
  };

  /// Inserts the born faces between the deformed faces and the faces across; all corners must be set.
  void join(const Split& split) noexcept;
  /// Undoes `join` for one face.
  void take_out(Face face, std::uint32_t order) noexcept;

 private:
  using Links = std::array<std::uint32_t, 3>;  // by corner, of the edge opposite: face << 2 | corner, or kNone
  static constexpr Corners kNowhere{kNone, kNone, kNone};
  static constexpr Links kNoLinks{kNone, kNone, kNone};
  struct Entry {
    Corners corners;
    Links opposite;
  };
  static_assert(sizeof(Entry) == kBytesPerFace);
  [[nodiscard]] std::uint32_t& opposite(std::uint32_t number) noexcept {
    return faces_[Face{number >> 2}].opposite[number & 3u];
  }
  [[nodiscard]] static std::uint32_t after(std::uint32_t corner) noexcept { return corner == 2 ? 0 : corner + 1; }
  [[nodiscard]] static std::uint32_t before(std::uint32_t corner) noexcept { return corner == 0 ? 2 : corner - 1; }
  /// Links two corners; each of them may be kNone.
  void link(std::uint32_t a, std::uint32_t b) noexcept {
    if (a != kNone) opposite(a) = b;
    if (b != kNone) opposite(b) = a;
  }
  [[nodiscard]] static std::uint32_t number(At at) noexcept { return index(at.face) << 2 | at.corner; }

  IdVector<Face, Entry> faces_;
};

/// In a file's ids.
using ModelFront = LoadedFront<FaceId, VertexId>;

/// The base mesh by FaceId; the corners of a face that a record bears are kNone. O(faces), allocates.
[[nodiscard]] ModelFront base_front(const ModelSummary& summary, std::span<const BaseFace> base_faces);

}  // namespace tactus::spm
