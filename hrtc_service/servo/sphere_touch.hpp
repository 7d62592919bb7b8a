/// Moves the proxy of a spherical probe, and computes its force on the hand.
///
/// World frame, SI. Haptic thread. Realtime.
#pragma once

#include "haptics/proxy.hpp"
#include "hrtc_service/servo/probe.hpp"

namespace tactus::hrtc_service {

class SphereTouch {
 public:
  /// `radius`: radius of the tip, m.
  explicit SphereTouch(double radius) noexcept;

  /// Resets the proxy. The next step starts at the device.
  void reset() noexcept { proxy_.reset(); }
  /// Sets haptics::ProxySettings::reach from the next step on.
  void set_reach(double reach) noexcept { proxy_.set_reach(reach); }

  /// Moves the proxy towards the device while the hand holds an object. Ignores `goal`, which only a tool needs.
  void move_to(const ProbeStep& step, const haptics::ToolPose& goal) noexcept;
  /// Moves the proxy towards the device and computes the force.
  const haptics::ForceResult& render(const ProbeStep& step) noexcept;

  /// Returns the point to which the device is coupled.
  [[nodiscard]] const Vec3d& coupling_point() const noexcept { return proxy_.last().anchor; }
  [[nodiscard]] const haptics::Proxy& proxy() const noexcept { return proxy_; }

  /// As Cycle::for_each_carried.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    proxy_.for_each_carried(visit);
  }

 private:
  [[nodiscard]] haptics::ContactImpedance apply_material(const ProbeStep& step) noexcept;

  double radius_;
  haptics::Proxy proxy_;
};

}  // namespace tactus::hrtc_service
