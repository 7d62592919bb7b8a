/// Collision queries of a proxy against all surfaces near it. World frame, metres.
///
/// An HRTC searches its AB-trees for triangles; a test searches a list. Each implementation passes the triangles that
/// it finds to FirstTouch or ClosestSide, which decide the result. Realtime throughout.
#pragma once

#include <cstdint>

#include "spm/triangle.hpp"

namespace tactus::haptics {

using spm::Vec3d;

struct SurfaceHit {
  double time = 1;              ///< sweep only: share of the motion before the contact, 0 to 1
  Vec3d point = Vec3d::Zero();  ///< on the surface
  /// After a sweep: from `point` to the sphere's centre. For a closest point: the outer normal.
  Vec3d normal = Vec3d::UnitZ();
  double distance = 0;  ///< closest point only: distance from the query, negative on the inner side
  bool is_side_known =
      true;  ///< closest point only; false: the side is unknown, at a border or where normals cancel out
  std::uint32_t object = spm::kNone;
  std::uint32_t face = spm::kNone;  ///< FaceId
};

/// Distance queries for the contacts of bodies with static geometry.
class SurfaceDistance {
 public:
  virtual ~SurfaceDistance() = default;

  /// Finds the closest point of all surfaces, and the side of the surface on which `point` lies. Returns false if no
  /// surface is closer than `max_distance`. Realtime.
  [[nodiscard]] virtual bool closest(const Vec3d& point, double max_distance, SurfaceHit& hit) const noexcept = 0;
};

/// Queries for one probe. An implementation may store candidates of one sweep for the next.
class Surface : public SurfaceDistance {
 public:
  /// Finds the first contact of a sphere whose centre moves straight from `from` to `to`. Both sides of all surfaces
  /// count. A sphere that rests on a triangle may slide along it or move away (spm::swept_sphere). Returns false
  /// without a contact. Realtime.
  [[nodiscard]] virtual bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept = 0;

  /// True when an object has moved since the last step. The next three functions then describe its motion.
  [[nodiscard]] virtual bool moving() const noexcept { return false; }
  /// Finds the first contact of a sphere whose centre was at `from` in the last step and is to be at `to` now. The path
  /// is straight in the frame of each object, so objects move during the sweep. `hit` has the current positions of the
  /// objects. Realtime.
  [[nodiscard]] virtual bool sweep_moving(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept {
    return sweep(from, to, radius, hit);
  }
  /// Returns the current position of the point of `object` that was at `point` in the last step. Realtime.
  [[nodiscard]] virtual Vec3d moved_point(std::uint32_t object, const Vec3d& point) const noexcept {
    static_cast<void>(object);
    return point;
  }
  /// Returns the current direction of the vector of `object` that was `direction` in the last step. Realtime.
  [[nodiscard]] virtual Vec3d rotated_direction(std::uint32_t object, const Vec3d& direction) const noexcept {
    static_cast<void>(object);
    return direction;
  }
};

/// Selects the earliest contact of a sweep with the added triangles. Of simultaneous contacts it selects the lowest
/// object number, then the lowest face. Add at least every triangle whose box overlaps the box of the swept sphere.
class FirstTouch {
 public:
  FirstTouch(const Vec3d& from, const Vec3d& to, double radius) noexcept : from_{from}, to_{to}, radius_{radius} {}

  /// Adds the triangle a, b, c, whose corners are counter-clockwise seen from outside.
  void add_triangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, std::uint32_t object, std::uint32_t face) noexcept;

  /// Returns the time of the earliest contact so far, as a share of the motion. Triangles with later contacts need not
  /// be added.
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

/// Finds the closest point of the added triangles, and the side of the surface on which the query point lies.
///
/// If several triangles share the closest point, on an edge or at a vertex, their normals are added with the weights of
/// their angles. The sum gives the correct side on every closed, consistently oriented surface. So add every triangle
/// whose distance is less than or equal to `reach()`.
/// Source: Baerentzen, Aanaes 2005 (signed distance from angle-weighted pseudo-normals).
class ClosestSide {
 public:
  ClosestSide(const Vec3d& query, double max_distance) noexcept : query_{query}, reach_{max_distance} {}

  void add_triangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, std::uint32_t object, std::uint32_t face) noexcept;

  /// Distance above which a triangle no longer changes the result.
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
