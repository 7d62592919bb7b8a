/// Contact of a probe with a moving body: moves a proxy in the body's frame, and couples device and body by a spring.
///
///     hand <-- stiffness (anchor - device) -- device ~~~~ anchor on the body -- same spring, implicit --> body
///
/// The stiffness is that of ContactImpedance. Without a grab the spring pushes while the device is inside the body,
/// with the friction of the proxy. Two probes that press from opposite sides can lift a body. With a grab the spring
/// also pulls: it ends at the point of the body where the grab began, until the grab button is released. The shape of
/// the body is any Surface in the body's frame. Tests and studies use this class; an HRTC uses hrtc_service/servo/bodies.hpp.
///
/// World frame unless a name says `body`, SI. One thread at a time. Realtime: the cost is one step of the proxy.
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
  [[nodiscard]] bool closest(const Vec3d& point, double max_distance, SurfaceHit& hit) const noexcept override;

 private:
  std::array<std::array<Vec3d, 3>, 12> triangles_;
};

class BodyTouch {
 public:
  explicit BodyTouch(const ProxySettings& settings = {}) noexcept : proxy_{settings} {}

  void set_grip(const Grip& grip) noexcept { proxy_.set_grip(grip); }
  void reset() noexcept { proxy_.reset(), grabbed_ = false, ramp_body_ = {}; }

  /// Computes one cycle with `device` in the world frame. `grab`: the grab button is down. Realtime.
  void step(const DeviceState& device, bool grab, const BodyState& body, Surface& shape_body,
            const ContactImpedance& impedance, double dt) noexcept;

  /// Returns whether the probe touches or holds the body. If not, the spring exerts no force.
  [[nodiscard]] bool is_touching() const noexcept { return touch_.in_contact; }
  [[nodiscard]] bool is_holding() const noexcept { return grabbed_; }
  /// The spring that acts on the body.
  [[nodiscard]] const PointSpring& spring() const noexcept { return spring_; }
  /// Contact in the world frame, for ForceRenderer.
  [[nodiscard]] const ProxyResult& touch() const noexcept { return touch_; }
  /// The device with its velocity relative to the body, for ForceRenderer. With the absolute velocity the force would
  /// also damp the common motion of hand and body.
  [[nodiscard]] const DeviceState& device() const noexcept { return relative_; }

 private:
  Proxy proxy_;  // in the body's frame
  ProxyResult touch_;
  PointSpring spring_;
  DeviceState relative_;
  Vec3d anchor_body_ = Vec3d::Zero();
  // m, subtracted from the anchor. If a probe starts inside the body, the ramp makes its force rise slowly.
  Ramp ramp_body_;
  bool grabbed_ = false;
};

}  // namespace tactus::haptics
