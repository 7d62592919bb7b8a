/// A probe that is a sphere: its proxy, and the force of the proxy on the hand.
///
/// World frame, SI. The haptic thread's. Realtime.
#pragma once

#include "haptics/proxy.hpp"
#include "hrtc_service/probe.hpp"

namespace tactus::hrtc_service {

class SphereTouch {
 public:
  /// `radius`: m.
  explicit SphereTouch(double radius) noexcept;

  /// Resets the proxy; the next step starts at the device.
  void reset() noexcept { proxy_.reset(); }
  /// haptics::ProxySettings::reach from the next step on.
  void set_reach(double reach) noexcept { proxy_.set_reach(reach); }

  /// Moves the proxy with the device while the hand holds an object.
  void carry(const ProbeStep& step, const haptics::ToolPose& held) noexcept;
  /// Moves the proxy towards the device and computes the force.
  const haptics::ForceResult& render(const ProbeStep& step) noexcept;

  /// What pulls the device.
  [[nodiscard]] const Vec3d& place() const noexcept { return proxy_.last().anchor; }
  [[nodiscard]] const haptics::Proxy& proxy() const noexcept { return proxy_; }

  /// As Cycle's.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    proxy_.for_each_carried(visit);
  }

 private:
  [[nodiscard]] haptics::Feel take_material(const ProbeStep& step) noexcept;

  double radius_;
  haptics::Proxy proxy_;
};

}  // namespace tactus::hrtc_service
