/// What a proxy touches: all surfaces near it, however they are stored. World frame, metres.
///
/// A controller answers from its AB-trees, a test from a list of triangles; both feed the triangles they find to the
/// two accumulators below, which hold the rules. Realtime throughout.
#pragma once

#include <cstdint>

#include "spm/triangle.hpp"

namespace tactus::haptics {

using spm::Vec3d;

struct SurfaceHit {
  double time = 1;              ///< of a sweep: share of the way at which it touches
  Vec3d point = Vec3d::Zero();  ///< on the surface
  Vec3d normal =
      Vec3d::UnitZ();   ///< of a sweep: from `point` to the sphere's centre; of a closest point: the outer normal
  double distance = 0;  ///< of a closest point: from the query, negative on the inner side
  bool sided = true;    ///< false where the surface has no sides: at a border, or where faces cancel out
  std::uint32_t object = spm::kNone;
  std::uint32_t face = spm::kNone;  ///< FaceId
};

/// What bodies stand on and bump into.
class SurfaceDistance {
 public:
  virtual ~SurfaceDistance() = default;

  /// The closest point of all surfaces and the side that `point` is on; false when none is nearer than `within`.
  /// Realtime.
  [[nodiscard]] virtual bool closest(const Vec3d& point, double within, SurfaceHit& hit) const noexcept = 0;
};

/// Belongs to one probe: what a sweep has found may be noted for the next.
class Surface : public SurfaceDistance {
 public:
  /// The earliest touch of a sphere whose centre goes straight from `from` to `to`, over everything that exists, both
  /// sides alike; by the rules of spm::swept_sphere a sphere that rests on a triangle may slide and leave. Realtime.
  [[nodiscard]] virtual bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept = 0;

  /// Whether something stands elsewhere than in the last step. What does is asked for by the three functions below.
  [[nodiscard]] virtual bool moving() const noexcept { return false; }
  /// The earliest touch of a sphere whose centre was at `from` when everything stood as in the last step, and is to be
  /// at `to` as it stands now. Relative to each object it goes straight, and what it touches goes along: `hit` tells it
  /// as it is now. Realtime.
  [[nodiscard]] virtual bool sweep_moving(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept {
    return sweep(from, to, radius, hit);
  }
  /// Where the place on `object` that was at `point` in the last step is now; and a direction. Realtime.
  [[nodiscard]] virtual Vec3d carried(std::uint32_t object, const Vec3d& point) const noexcept {
    static_cast<void>(object);
    return point;
  }
  [[nodiscard]] virtual Vec3d turned(std::uint32_t object, const Vec3d& direction) const noexcept {
    static_cast<void>(object);
    return direction;
  }
};

/// The earliest of the touches offered, of several at once that of the first object and face. Offer at least every
/// triangle whose box meets the swept sphere's.
class FirstTouch {
 public:
  FirstTouch(const Vec3d& from, const Vec3d& to, double radius) noexcept : from_{from}, to_{to}, radius_{radius} {}

  /// Corners in counter-clockwise order seen from outside.
  void offer(const Vec3d& a, const Vec3d& b, const Vec3d& c, std::uint32_t object, std::uint32_t face) noexcept;

  /// Touches later than this no longer matter.
  [[nodiscard]] double time() const noexcept { return best_.time; }
  [[nodiscard]] bool result(SurfaceHit& hit) const noexcept;

 private:
  [[nodiscard]] bool comes_before(std::uint32_t object, std::uint32_t face) const noexcept {
    return object != best_.object ? object < best_.object : face < best_.face;
  }

  Vec3d from_, to_;
  double radius_;
  SurfaceHit best_;
  bool found_ = false;
};

/// The closest point of the triangles offered, and the side of the surface that the query is on.
///
/// Triangles that share the closest point (an edge, a vertex) add up to the angle-weighted normal there, whose sign is
/// right on every closed, consistently oriented surface. So offer every triangle nearer than *or as near as* `reach()`.
/// Source: Baerentzen, Aanaes 2005 (signed distance from angle-weighted pseudo-normals).
class ClosestSide {
 public:
  ClosestSide(const Vec3d& query, double within) noexcept : query_{query}, reach_{within} {}

  void offer(const Vec3d& a, const Vec3d& b, const Vec3d& c, std::uint32_t object, std::uint32_t face) noexcept;

  /// Triangles further away than this no longer matter.
  [[nodiscard]] double reach() const noexcept { return reach_; }
  [[nodiscard]] bool result(SurfaceHit& hit) const noexcept;

 private:
  Vec3d query_;
  double reach_;
  Vec3d point_ = Vec3d::Zero();
  Vec3d normal_ = Vec3d::Zero();  // sum of weighted unit normals
  int faces_ = 0;                 // that share the closest point
  bool on_edge_ = false;
  std::uint32_t object_ = spm::kNone;
  std::uint32_t face_ = spm::kNone;
};

}  // namespace tactus::haptics
