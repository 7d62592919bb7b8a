/// Collision queries for a proxy over all surfaces near it. World frame, metres.
///
/// An HRTC answers from its AB-trees, a test from a list of triangles. Both pass the triangles that they find to the
/// two accumulators below, which contain the rules. Realtime throughout.
#pragma once

#include <cstdint>

#include "spm/triangle.hpp"

namespace tactus::haptics {

using spm::Vec3d;

struct SurfaceHit {
  double time = 1;              ///< of a sweep: share of the motion at the first contact
  Vec3d point = Vec3d::Zero();  ///< on the surface
  Vec3d normal =
      Vec3d::UnitZ();   ///< of a sweep: from `point` to the sphere's centre; of a closest point: the outer normal
  double distance = 0;  ///< of a closest point: from the query, negative on the inner side
  bool sided = true;    ///< false at a border, or where face normals cancel out
  std::uint32_t object = spm::kNone;
  std::uint32_t face = spm::kNone;  ///< FaceId
};

/// Distance queries for the contacts of bodies with static geometry.
class SurfaceDistance {
 public:
  virtual ~SurfaceDistance() = default;

  /// The closest point of all surfaces and the side that `point` is on; false when no surface is closer than `within`.
  /// Realtime.
  [[nodiscard]] virtual bool closest(const Vec3d& point, double within, SurfaceHit& hit) const noexcept = 0;
};

/// Belongs to one probe: what a sweep has found may be noted for the next.
class Surface : public SurfaceDistance {
 public:
  /// The first contact of a sphere whose centre moves straight from `from` to `to`, over all surfaces, from both sides.
  /// By the rules of spm::swept_sphere a sphere that rests on a triangle may slide and leave. Realtime.
  [[nodiscard]] virtual bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept = 0;

  /// True when an object has moved since the last step. The next three functions then describe its motion.
  [[nodiscard]] virtual bool moving() const noexcept { return false; }
  /// The first contact of a sphere whose centre was at `from` in the last step and is to be at `to` now. Relative to
  /// each object it moves straight, and a touched surface moves along. `hit` has present positions. Realtime.
  [[nodiscard]] virtual bool sweep_moving(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept {
    return sweep(from, to, radius, hit);
  }
  /// The present position of the point of `object` that was at `point` in the last step. Realtime.
  [[nodiscard]] virtual Vec3d carried(std::uint32_t object, const Vec3d& point) const noexcept {
    static_cast<void>(object);
    return point;
  }
  /// The same for a direction. Realtime.
  [[nodiscard]] virtual Vec3d turned(std::uint32_t object, const Vec3d& direction) const noexcept {
    static_cast<void>(object);
    return direction;
  }
};

/// The earliest contact among the triangles offered; of several at once the one with the lowest object and face. Offer
/// at least every triangle whose box overlaps the box of the swept sphere.
class FirstTouch {
 public:
  FirstTouch(const Vec3d& from, const Vec3d& to, double radius) noexcept : from_{from}, to_{to}, radius_{radius} {}

  /// Corners counter-clockwise seen from outside.
  void offer(const Vec3d& a, const Vec3d& b, const Vec3d& c, std::uint32_t object, std::uint32_t face) noexcept;

  /// Later contacts no longer matter.
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
/// Triangles that share the closest point (on an edge or at a vertex) add up to the angle-weighted normal there. Its
/// sign is correct on every closed, consistently oriented surface. So offer every triangle closer than *or as close as*
/// `reach()`.
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
  int faces_ = 0;                 // faces that share the closest point
  bool on_edge_ = false;
  std::uint32_t object_ = spm::kNone;
  std::uint32_t face_ = spm::kNone;
};

}  // namespace tactus::haptics
