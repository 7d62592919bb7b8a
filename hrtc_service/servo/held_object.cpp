#include "hrtc_service/servo/held_object.hpp"

#include "haptics/rigid_body.hpp"

namespace tactus::hrtc_service {

std::uint32_t HeldObject::release_if_open(const haptics::DeviceState& device) noexcept {
  if ((device.buttons & haptics::kGrabButton) == 0) grasp_ = {};
  return held_.object = grasp_.object;
}

void HeldObject::follow_object(const ProbeStep& step, const TouchObject& object, const Placement& before,
                               const Placement& now) noexcept {
  const Eigen::Quaterniond turn{now.rotation()}, turn_before{before.rotation()};
  const Vec3d point = vec(grasp_.point);
  held_.hold.pose = {now.to_world(point), (turn * quaternion(grasp_.orientation)).normalized()};
  held_.hold.velocity = (held_.hold.pose.position - before.to_world(point)) / step.period;
  held_.hold.angular_velocity = haptics::log_map(turn * turn_before.conjugate()) / step.period;
  held_.impedance = step.stable(object.material);
  held_.grip = step.renderer.hold_grip(held_.impedance, step.period, step.input.device.round_trip);
}

const haptics::ForceResult& HeldObject::render(const ProbeStep& step, double zero_force_age) noexcept {
  const haptics::DeviceState& device = step.input.device;
  const haptics::ForceResult& force =
      step.renderer.step(held_.hold, held_.grip, device, held_.impedance, step.age(), step.period);
  held_.pull =
      haptics::wrench_of(held_.hold, held_.grip, held_.impedance.damping, device, step.renderer.angular_velocity());
  ProbeOutput& output = step.output;
  output.proxy = plain(held_.hold.pose.position);
  output.force = plain(force.force);
  output.torque = plain(force.torque);
  output.object = held_.object;
  output.stiffness = static_cast<float>(held_.grip.stiffness);
  output.status |= session::kInContact | session::kHolding;
  if (force.fault != haptics::Fault::kNone || step.age() >= zero_force_age) {
    grasp_ = {};
    grasp_.must_open = true;
  }
  return force;
}

void HeldObject::hold_if_closed(const ProbeStep& step, const Vec3d& point, const Placement& placement,
                                bool can_move) noexcept {
  const haptics::DeviceState& device = step.input.device;
  if ((device.buttons & haptics::kGrabButton) == 0) return;
  const bool has_fault = (step.output.status & session::kFault) != 0;
  if (grasp_.must_open || has_fault || !can_move) {
    if (has_fault) grasp_.must_open = true;  // a reset must not begin a grasp
    step.output.status |= session::kHoldRefused;
    return;
  }
  grasp_.object = step.output.object;
  grasp_.point = plain(placement.to_model(point));
  grasp_.orientation = plain(Eigen::Quaterniond{placement.rotation()}.conjugate() * device.orientation);
}

}  // namespace tactus::hrtc_service
