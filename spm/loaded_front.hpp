/// The mesh at the loaded front: every face's corners once all records at hand are applied, and the face across each of
/// its edges. Faces and vertices are numbered by whoever keeps it: slots in the cache, ids elsewhere.
///
///         g                     g            A split puts each face that it bears into one edge (t, x): between the
///     t--------x            t--------x       face that it deforms there, f, and the one across, g. Two splits that
///      \  f   /   split      \  born/ \      need not know of each other put theirs at either side of what is there
///       \    /    ----->      \    / f \     between f and g, so whatever the order, the faces lie in the same one;
///       and
///        \  /                  \  /_____\    taking one out lets its two neighbours meet.
///                               u
///
/// So the faces that an absent record deforms lie side by side at every receiver as they did where it was coded: what
/// else is loaded cannot have come between them. Where three faces meet at an edge, or two that face opposite sides,
/// none is across the other; a record is coded to do without.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/ids.hpp"
#include "spm/model.hpp"
#include "spm/record.hpp"
#include "spm/span.hpp"

namespace tactus::spm {

class LoadedFront {
 public:
  using Corners = std::array<std::uint32_t, 3>;
  /// A corner of a face. It stands for the edge opposite of it, too.
  struct At {
    std::uint32_t face, corner;
  };

  static constexpr std::size_t kBytesPerFace = 24;

  explicit LoadedFront(std::size_t faces) : faces_(faces, Face{kNowhere, kNowhere}) {}

  [[nodiscard]] Corners& corners(std::uint32_t face) noexcept { return faces_[face].corners; }
  [[nodiscard]] const Corners& corners(std::uint32_t face) const noexcept { return faces_[face].corners; }

  /// Sets faces that nothing is across of yet.
  void set(std::uint32_t face, const Corners& corners) noexcept { faces_[face] = {corners, kNowhere}; }
  /// Finds who is across whom among these, which have been set. O(n log n), allocates.
  void link(Span<const std::uint32_t> faces);

  /// The face around the vertex at `at` that follows counter-clockwise, seen from outside: across the edge from that
  /// vertex to the corner before it. False when there is none.
  [[nodiscard]] bool swing(At& at) const noexcept {
    const std::uint32_t opposite = faces_[at.face].opposite[after(at.corner)];
    if (opposite == kNone) return false;
    at = {opposite >> 2, after(opposite & 3u)};
    return true;
  }

  /// The faces of one split. A split of more than fit is joined to nothing.
  class Split {
   public:
    static constexpr std::uint32_t kMaxDeformed = 32, kMaxBorn = 4;
    /// `at`: where u stands now.
    void deform(At at) noexcept {
      if (deformed_count_++ < kMaxDeformed) deformed_[deformed_count_ - 1] = at;
    }
    void bear(std::uint32_t face, std::uint32_t order) noexcept {
      if (born_count_++ < kMaxBorn) born_[born_count_ - 1] = {face, born_corners(order), order % 2 == 0};
    }

   private:
    friend class LoadedFront;
    struct Born {
      std::uint32_t face;
      BornCorners at;
      bool even;  // x comes before u, so that the edge between goes from x to u
    };
    std::uint32_t deformed_count_ = 0, born_count_ = 0;
    std::array<At, kMaxDeformed> deformed_;
    std::array<Born, kMaxBorn> born_;
  };

  /// Puts the faces that a split bears between those that it deforms and what was across; all have their corners.
  void join(const Split& split) noexcept;
  /// Undoes `join` for one face that was borne in this order.
  void take_out(std::uint32_t face, std::uint32_t order) noexcept;

 private:
  static constexpr Corners kNowhere{kNone, kNone, kNone};
  struct Face {
    Corners corners;
    std::array<std::uint32_t, 3> opposite;  // by corner, of the opposite edge: face << 2 | corner; kNone: nothing
  };
  static_assert(sizeof(Face) == kBytesPerFace);
  [[nodiscard]] static std::uint32_t after(std::uint32_t corner) noexcept { return corner == 2 ? 0 : corner + 1; }
  [[nodiscard]] static std::uint32_t before(std::uint32_t corner) noexcept { return corner == 0 ? 2 : corner - 1; }
  [[nodiscard]] std::uint32_t& opposite(At at) noexcept { return faces_[at.face].opposite[at.corner]; }
  /// Makes these meet, either of which may be nothing.
  void meet(std::uint32_t a, std::uint32_t b) noexcept {
    if (a != kNone) faces_[a >> 2].opposite[a & 3u] = b;
    if (b != kNone) faces_[b >> 2].opposite[b & 3u] = a;
  }
  [[nodiscard]] static std::uint32_t number(At at) noexcept { return at.face << 2 | at.corner; }

  std::vector<Face> faces_;
};

/// The base mesh by FaceId; a face that is not there has kNone at all corners. O(faces), allocates.
[[nodiscard]] LoadedFront base_front(const ModelSummary& summary, Span<const BaseFace> base_faces);

}  // namespace tactus::spm
