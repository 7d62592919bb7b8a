/// A corner table of the mesh at the loaded front. It stores the vertices of each face after all loaded records, and
/// for each edge the opposite corner in the face across the edge.
///
///         g                     g            A split inserts each born face at an edge (t, x), between the deformed
///     t--------x            t--------x       face f and the face g across the edge. Two independent splits insert
///      \  f   /   split      \  born/ \      their faces on different sides of the same neighbours, so their order
///       \    /    ----->      \    / f \     makes no difference. `unlink` removes a face and links its neighbours.
///        \  /                  \  /______\    u: the new vertex
///                               u
///
/// Consider a receiver that lacks a record. Whichever other records are loaded there, the faces that the record deforms
/// are neighbours of each other, as at the encoder. An edge with three faces, or with two faces of opposite
/// orientation, has no opposite corner, and the encoder does not need one.
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

/// `Face` and `Vertex` are RowIndex and Slot in the cache, FaceId and VertexId elsewhere. `Stored` is the type of
/// stored corners. If it cannot be kNone, the corners of a face are undefined until `set`.
template <class Face, class Vertex, class Stored = Vertex>
class LoadedFront {
 public:
  using Corners = std::array<Vertex, 3>;
  /// A corner of a face. It also denotes the edge opposite to it.
  struct CornerRef {
    Face face;
    std::uint32_t corner;
  };

  static constexpr std::size_t kBytesPerFace = 3 * (sizeof(Stored) + sizeof(std::uint32_t));

  explicit LoadedFront(std::size_t faces)
      : corners_(faces, {Stored{kNone}, Stored{kNone}, Stored{kNone}}), opposite_(faces, kNoLinks) {}

  [[nodiscard]] Corners corners(Face face) const noexcept {
    const auto& [a, b, c] = corners_[face];
    return {a, b, c};
  }
  void set_corner(CornerRef at, Vertex vertex) noexcept { corners_[at.face][at.corner] = vertex; }

  /// Sets the corners of a face and removes its links.
  void set(Face face, const Corners& corners) noexcept {
    corners_[face] = {Stored{corners[0]}, Stored{corners[1]}, Stored{corners[2]}};
    opposite_[face] = kNoLinks;
  }
  /// Links faces across their common edges. Their corners must have been set. O(n log n), allocates.
  void link(std::span<const Face> faces);

  /// Moves `at` to the next face around its vertex, counter-clockwise seen from outside. False if there is none.
  [[nodiscard]] bool swing(CornerRef& at) const noexcept {
    const std::uint32_t opposite = opposite_[at.face][next_corner(at.corner)];
    if (opposite == kNone) return false;
    at = {Face{opposite >> 2}, next_corner(opposite & 3u)};
    return true;
  }

  /// The faces of one split. If there are more than fit, `link_split` does nothing.
  class Split {
   public:
    static constexpr std::uint32_t kMaxDeformed = 32, kMaxBorn = 4;
    /// Adds a deformed face. u is at its corner `at`.
    void deform(CornerRef at) noexcept {
      if (deformed_count_++ < kMaxDeformed) deformed_[deformed_count_ - 1] = at;
    }
    /// Adds a born face.
    void add_born_face(Face face, std::uint32_t order) noexcept {
      if (born_count_++ < kMaxBorn) born_[born_count_ - 1] = {face, order};
    }

   private:
    friend class LoadedFront;
    struct Born {
      Face face;
      std::uint32_t order;  // 0: the edge between x and u goes from x to u; 1: from u to x
    };
    std::uint32_t deformed_count_ = 0, born_count_ = 0;
    std::array<CornerRef, kMaxDeformed> deformed_;
    std::array<Born, kMaxBorn> born_;
  };

  /// Links the born faces between the deformed faces and the faces across the edges. All corners must be set.
  void link_split(const Split& split) noexcept;
  /// Undoes `link_split` for one born face.
  void unlink(Face face, std::uint32_t order) noexcept;

 private:
  // By corner: the corner across the edge opposite to it, as face << 2 | corner, or kNone.
  using Links = std::array<std::uint32_t, 3>;
  static constexpr Links kNoLinks{kNone, kNone, kNone};
  [[nodiscard]] std::uint32_t& opposite(std::uint32_t number) noexcept {
    return opposite_[Face{number >> 2}][number & 3u];
  }
  [[nodiscard]] static std::uint32_t next_corner(std::uint32_t corner) noexcept { return corner == 2 ? 0 : corner + 1; }
  [[nodiscard]] static std::uint32_t previous_corner(std::uint32_t corner) noexcept {
    return corner == 0 ? 2 : corner - 1;
  }
  /// Links two corners; each of them may be kNone.
  void link(std::uint32_t a, std::uint32_t b) noexcept {
    if (a != kNone) opposite(a) = b;
    if (b != kNone) opposite(b) = a;
  }
  [[nodiscard]] static std::uint32_t number(CornerRef at) noexcept { return index(at.face) << 2 | at.corner; }

  IdVector<Face, std::array<Stored, 3>> corners_;
  IdVector<Face, Links> opposite_;
};

using ModelFront = LoadedFront<FaceId, VertexId>;

/// Returns the front of the base mesh. The corners of faces that records bear are kNone. O(faces), allocates.
[[nodiscard]] ModelFront base_front(const ModelSummary& summary, std::span<const BaseFace> base_faces);

}  // namespace tactus::spm
