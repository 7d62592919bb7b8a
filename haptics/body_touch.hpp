/// Contact of a probe with a moving body: a proxy in the body's own frame, and the spring between device and proxy.
///
///     hand <-- stiffness (anchor - device) -- device ~~~~ anchor on the body -- same spring, implicit --> body
///
/// A push acts while the device is pressed in, with the proxy's friction. Two probes that press from opposite sides can
/// lift a body. A grab acts in all directions at the point where it began, until the grab button is released. The shape
/// is any Surface in the body's frame: a box here, a refined mesh in an HRTC.
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

/// The faces of a box centred at the origin, oriented outwards.
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

  /// One cycle with `device` in the world frame. `grab`: hold the body at the contact point. Realtime.
  void step(const DeviceState& device, bool grab, const BodyState& body, Surface& shape_body, const Feel& feel,
            double dt) noexcept;

  /// True when the probe touches or holds the body; otherwise the spring exerts no force.
  [[nodiscard]] bool touching() const noexcept { return touch_.in_contact; }
  [[nodiscard]] bool holding() const noexcept { return grabbed_; }
  /// The spring that acts on the body.
  [[nodiscard]] const PointSpring& spring() const noexcept { return spring_; }
  /// Contact in the world frame, for ForceRenderer.
  [[nodiscard]] const ProxyResult& touch() const noexcept { return touch_; }
  /// The device with its velocity relative to the body, for ForceRenderer. An absolute velocity would damp both of
  /// them.
  [[nodiscard]] const DeviceState& device() const noexcept { return relative_; }

 private:
  Proxy proxy_;  // in the body's frame
  ProxyResult touch_;
  PointSpring spring_;
  DeviceState relative_;
  Vec3d anchor_body_ = Vec3d::Zero();
  Ramp ramp_body_;  // m; a probe that starts inside the body builds up its force gradually
  bool grabbed_ = false;
};

}  // namespace tactus::haptics
