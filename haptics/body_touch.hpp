/// A probe on a body that moves: the proxy in the body's own frame, so that it rides along, and the spring between.
///
///     hand <-- stiffness (anchor - device) -- device ~~~~ anchor on the body -- the same, on the body, implicitly -->
///
/// A push holds while the device is pressed in, with the proxy's friction; two probes that press from opposite sides
/// lift by it. A grab holds both ways, at the point where it began, until let go. Any Surface in the body's frame
/// serves as its shape: a box here, a refined mesh in a controller.
///
/// World frame where no other is named, SI. One thread at a time. Realtime: one step of the proxy.
#pragma once

#include <array>

#include "haptics/device.hpp"
#include "haptics/force.hpp"
#include "haptics/proxy.hpp"
#include "haptics/ramp.hpp"
#include "haptics/rigid_body.hpp"

namespace tactus::haptics {

/// The faces of a box around the origin, outside out.
class BoxSurface final : public Surface {
 public:
  explicit BoxSurface(const Vec3d& half_extents) noexcept;
  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept override;
  [[nodiscard]] bool closest(const Vec3d& point, double within, SurfaceHit& hit) const noexcept override;

 private:
  std::array<std::array<Vec3d, 3>, 12> triangles_;
};

class BodyTouch {
 public:
  explicit BodyTouch(const ProxySettings& settings = {}) noexcept : proxy_{settings} {}

  void set_grip(const Grip& grip) noexcept { proxy_.set_grip(grip); }
  void reset() noexcept { proxy_.reset(), grabbed_ = false, ramp_body_ = {}; }

  /// One cycle with the device where `device` says, in the world. `grab`: hold on to where it touches. Realtime.
  void step(const DeviceState& device, bool grab, const BodyState& body, Surface& shape_body, const Feel& feel,
            double dt) noexcept;

  /// It touches or holds; else the spring pulls nothing.
  [[nodiscard]] bool touching() const noexcept { return touch_.in_contact; }
  [[nodiscard]] bool holding() const noexcept { return grabbed_; }
  /// On the body.
  [[nodiscard]] const PointSpring& spring() const noexcept { return spring_; }
  /// For ForceRenderer, in the world.
  [[nodiscard]] const ProxyResult& touch() const noexcept { return touch_; }
  /// The device as the body sees it move, for ForceRenderer: a damper that rides along must not brake both.
  [[nodiscard]] const DeviceState& device() const noexcept { return relative_; }

 private:
  Proxy proxy_;  // in the body's frame
  ProxyResult touch_;
  PointSpring spring_;
  DeviceState relative_;
  Vec3d anchor_body_ = Vec3d::Zero();
  Ramp ramp_body_;  // m: a probe that begins in the body's surface is not pushed out at once, nor the body away
  bool grabbed_ = false;
};

}  // namespace tactus::haptics
