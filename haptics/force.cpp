#include "haptics/force.hpp"

#include <algorithm>
#include <cmath>

#include "haptics/rigid_body.hpp"

namespace tactus::haptics {
namespace {

constexpr double kAgeTolerance = 1e-9;  // s, for differences of large times

/// Shortens a force to `limit`. Returns a shorter force unchanged. If the limit is NaN, so is the result, which is a
/// fault.
Vec3d limited(const Vec3d& force, double limit) noexcept {
  const double size = force.norm();
  return size <= limit ? force : Vec3d(force * (limit / size));
}

/// Damping force along a contact normal, or damping torque along an axis. It may cancel the push but not turn it into a
/// pull.
double damping_along(const Vec3d& force, const Vec3d& normal, const Vec3d& velocity, double damping) noexcept {
  return std::max(-std::max(0.0, force.dot(normal)), -damping * velocity.dot(normal));
}

bool is_unit(const Eigen::Quaterniond& orientation) noexcept {
  constexpr double kTolerance = 1e-3;
  return std::abs(orientation.norm() - 1) <= kTolerance;
}

Vec3d rotation_between(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) noexcept {
  return log_map(to * from.conjugate());
}

/// Force of spring and damper of a contact.
Vec3d contact_force(const ProxyResult& proxy, const DeviceState& device, double stiffness, double damping) noexcept {
  Vec3d force = stiffness * (proxy.anchor - device.position);
  if (proxy.in_contact)
    force += damping_along(force, proxy.normal, device.velocity - proxy.surface_velocity, damping) * proxy.normal;
  return force;
}

}  // namespace

Vec3d rotation_to(const Hold& hold, const DeviceState& device) noexcept {
  return rotation_between(device.orientation, hold.pose.orientation);
}

Wrench wrench_of(const Hold& hold, const ToolGrip& grip, double damping, const DeviceState& device,
                 const Vec3d& angular_velocity) noexcept {
  return {grip.stiffness * (hold.pose.position - device.position) + damping * (hold.velocity - device.velocity),
          grip.rotational_stiffness * rotation_to(hold, device) +
              grip.angular_damping * (hold.angular_velocity - angular_velocity)};
}

ContactImpedance ForceRenderer::with_stable_damping(const ContactImpedance& impedance, double dt,
                                                    double round_trip) noexcept {
  constexpr double kDeviceMass = 0.1;  // kg, less than that of a device with a hand
  return {impedance.stiffness, std::min(impedance.damping, stable_damping(kDeviceMass, dt, round_trip))};
}

double ForceRenderer::stiffness(const ContactImpedance& impedance, double dt, double round_trip) const noexcept {
  return std::min(
      {impedance.stiffness, spec_.max_stiffness, stable_stiffness(spec_.damping, impedance.damping, dt, round_trip)});
}

ToolGrip ForceRenderer::grip_with(double arm, const ContactImpedance& impedance, double dt,
                                  double round_trip) const noexcept {
  constexpr double kAngularDamping = 0.01;  // s, ratio of damping to rotational stiffness
  const double stiffness = this->stiffness(impedance, dt, round_trip);
  const double rotational_stiffness = stiffness * arm * arm;
  // A device without torque cannot become unstable by torque.
  const double limited_stiffness =
      has_torque() ? std::min(rotational_stiffness, spec_.max_rotational_stiffness) : rotational_stiffness;
  return {stiffness, limited_stiffness, kAngularDamping * limited_stiffness};
}

ToolGrip ForceRenderer::tool_grip(const ContactImpedance& impedance, double dt, double round_trip) const noexcept {
  constexpr double kArm = 0.01;  // m
  return grip_with(kArm, impedance, dt, round_trip);
}

ToolGrip ForceRenderer::hold_grip(const ContactImpedance& impedance, double dt, double round_trip) const noexcept {
  constexpr double kArm = 0.05;  // m
  return grip_with(kArm, impedance, dt, round_trip);
}

void ForceRenderer::latch(Fault fault) noexcept {
  if (result_.fault == Fault::kNone) result_.fault = fault;
  result_.force.setZero();
  result_.torque.setZero();
  result_.bits = kForceFault;
}

void ForceRenderer::reset() noexcept { *this = ForceRenderer{settings_, spec_}; }

void ForceRenderer::advance_gain(double pose_age, double dt) noexcept {
  const double fresh = std::clamp(
      (settings_.zero_force_age - pose_age) / (settings_.zero_force_age - settings_.max_fresh_age), 0.0, 1.0);
  if (fresh < 1) {
    result_.bits |= kForceStale;
    // A pose that goes stale during the soft start does not shorten the soft start.
    if (gain_ >= 1) rise_time_ = settings_.recovery;
    gain_ = std::min(gain_, fresh);
    return;
  }
  if (gain_ < 1) {
    const double rise_time = rise_time_ < 0 ? settings_.soft_start : rise_time_;
    gain_ = rise_time > 0 ? std::min(1.0, gain_ + dt / rise_time) : 1.0;
  }
}

/// Returns whether a force acts and the device moves faster than a hand can move it against a force.
bool ForceRenderer::too_fast(const DeviceState& device, double dt) noexcept {
  double speed = device.velocity.norm(), angular_velocity = 0;
  if (has_pose_) {
    // A repeated pose adds no motion. The motion since an older pose took more than one cycle.
    const double passed = std::max(dt, static_cast<double>(device.time_ns - time_ns_) * 1e-9);
    speed = std::max(speed, (device.position - position_).norm() / passed);
    const bool turns = is_unit(device.orientation) && is_unit(orientation_);
    const Vec3d turned = turns ? rotation_between(orientation_, device.orientation) : Vec3d(Vec3d::Zero());
    constexpr double kSmoothing = 0.005;  // s
    angular_velocity_ += (turned / passed - angular_velocity_) * (dt / (kSmoothing + dt));
    if (!result_.torque.isZero(0)) angular_velocity = turned.norm() / passed;
  }
  has_pose_ = true;
  position_ = device.position;
  orientation_ = device.orientation;
  time_ns_ = device.time_ns;
  const bool acts = !result_.force.isZero(0) || !result_.torque.isZero(0);
  return acts && (speed > settings_.max_speed || angular_velocity > settings_.max_angular_velocity);
}

const ForceResult& ForceRenderer::reported() noexcept {
  result_.began = result_.bits & ~bits_before_;
  bits_before_ = result_.bits;
  return result_;
}

const ForceResult& ForceRenderer::step(const ProxyResult& proxy, const DeviceState& device,
                                       const ContactImpedance& impedance, double pose_age, double dt,
                                       const ProxyResult* unchanged) noexcept {
  if (result_.fault == Fault::kNone) render(proxy, device, impedance, pose_age, dt, unchanged);
  return reported();
}

const ForceResult& ForceRenderer::step(const ToolResult& tool, const ToolGrip& grip, const DeviceState& device,
                                       const ContactImpedance& impedance, double pose_age, double dt) noexcept {
  if (result_.fault == Fault::kNone) render(tool, grip, device, impedance, pose_age, dt);
  return reported();
}

const ForceResult& ForceRenderer::step(const Hold& hold, const ToolGrip& grip, const DeviceState& device,
                                       const ContactImpedance& impedance, double pose_age, double dt) noexcept {
  if (result_.fault == Fault::kNone) render(hold, grip, device, impedance, pose_age, dt);
  return reported();
}

Vec3d ForceRenderer::ramped(const Vec3d& pressed, const Vec3d& normal) noexcept {
  if (ramp_.done()) return pressed;
  // The force that continues from before the change of the surface may be a pull towards the new surface. This pull
  // must not grow.
  const double max = std::max(0.0, -last_.dot(normal));
  const double pull = -(pressed - ramp_.remaining()).dot(normal);
  if (pull > max) ramp_.set(ramp_.remaining() - normal * (pull - max));
  return pressed - ramp_.remaining();
}

bool ForceRenderer::admit(const DeviceState& device, const ContactImpedance& impedance, double pose_age,
                          double dt) noexcept {
  const bool finite = device.position.allFinite() && device.velocity.allFinite() && std::isfinite(pose_age) &&
                      std::isfinite(impedance.stiffness) && std::isfinite(impedance.damping) && std::isfinite(dt) &&
                      std::isfinite(device.round_trip);
  if (!finite) {
    latch(Fault::kInputNotFinite);
    return false;
  }
  if (too_fast(device, dt)) {
    latch(Fault::kTooFast);
    return false;
  }
  result_.bits = 0;
  return true;
}

void ForceRenderer::render(const ProxyResult& proxy, const DeviceState& device, const ContactImpedance& impedance,
                           double pose_age, double dt, const ProxyResult* unchanged) noexcept {
  const auto is_finite = [](const ProxyResult& at) { return at.anchor.allFinite() && at.normal.allFinite(); };
  if (!is_finite(proxy) || (unchanged != nullptr && !is_finite(*unchanged))) return latch(Fault::kInputNotFinite);
  if (!admit(device, impedance, pose_age, dt)) return;

  const double stiffness = this->stiffness(impedance, dt, device.round_trip);
  // The force is limited before the ramp too. Otherwise the part above the limit, which nobody can feel, would lengthen
  // the ramp.
  bool saturated = false;
  const auto pressed = [&](const ProxyResult& at) noexcept {
    const Vec3d whole = contact_force(at, device, stiffness, impedance.damping);
    const Vec3d bounded = limited(whole, max_force());
    saturated = saturated || bounded != whole;
    return bounded;
  };
  Vec3d force = pressed(proxy);
  ramp_.advance(kSurfaceRamp * dt);
  const Vec3d unchanged_force = unchanged != nullptr ? pressed(*unchanged) : force;
  if (unchanged == nullptr || (unchanged_force == force && unchanged->normal == proxy.normal)) {
    force = ramped(force, proxy.normal);
  } else {
    const Vec3d continued = ramped(unchanged_force, unchanged->normal);
    ramp_.set(force - continued);
    force = continued;
  }
  last_ = force;
  if (saturated) result_.bits |= kForceSaturated;
  if (!force.isZero(0) && stiffness < impedance.stiffness) result_.bits |= kForceStiffnessCut;
  if (!ramp_.done()) result_.bits |= kForceSurfaceRamp;
  limit(force, Vec3d::Zero(), pose_age, dt);
}

void ForceRenderer::render(const ToolResult& tool, const ToolGrip& grip, const DeviceState& device,
                           const ContactImpedance& impedance, double pose_age, double dt) noexcept {
  const bool finite = tool.displacement.allFinite() && tool.rotation.allFinite() && tool.normal.allFinite() &&
                      std::isfinite(grip.stiffness) && std::isfinite(grip.rotational_stiffness) &&
                      is_unit(device.orientation);
  if (!finite) return latch(Fault::kInputNotFinite);
  if (!admit(device, impedance, pose_age, dt)) return;
  Vec3d force = grip.stiffness * tool.displacement;
  if (tool.in_contact) force += damping_along(force, tool.normal, device.velocity, impedance.damping) * tool.normal;
  if (!force.isZero(0) && grip.stiffness < impedance.stiffness) result_.bits |= kForceStiffnessCut;
  Vec3d torque = grip.rotational_stiffness * tool.rotation;
  if (const double size = torque.norm(); tool.in_contact && size > 0) {
    const Vec3d axis = torque / size;
    torque += damping_along(torque, axis, angular_velocity_, grip.angular_damping) * axis;
  }
  limit(force, torque, pose_age, dt);
}

void ForceRenderer::render(const Hold& hold, const ToolGrip& grip, const DeviceState& device,
                           const ContactImpedance& impedance, double pose_age, double dt) noexcept {
  const bool finite = hold.pose.position.allFinite() && is_unit(hold.pose.orientation) && hold.velocity.allFinite() &&
                      hold.angular_velocity.allFinite() && std::isfinite(grip.stiffness) &&
                      std::isfinite(grip.rotational_stiffness) && std::isfinite(grip.angular_damping) &&
                      is_unit(device.orientation);
  if (!finite) return latch(Fault::kInputNotFinite);
  if (!admit(device, impedance, pose_age, dt)) return;
  const Wrench pull = wrench_of(hold, grip, impedance.damping, device, angular_velocity_);
  if (!pull.force.isZero(0) && grip.stiffness < impedance.stiffness) result_.bits |= kForceStiffnessCut;
  limit(pull.force, pull.torque, pose_age, dt);
}

Vec3d slewed(const Vec3d& wanted, const Vec3d& before, double max_change) noexcept {
  const Vec3d change = wanted - before;
  const double size = change.norm();
  return size <= max_change ? wanted : Vec3d(before + change * (max_change / size));
}

/// Adds the fading force and torque of a withdrawn object.
void ForceRenderer::fade(Vec3d& force, Vec3d& torque, double dt) noexcept {
  fading_.advance(kSurfaceRamp * dt);
  fading_torque_.advance(kTorqueRamp * dt);
  if (released_ && gain_ > 0) {
    fading_.set(force - limited(Vec3d(result_.force / gain_), max_force()));
    fading_torque_.set(torque - limited(Vec3d(result_.torque / gain_), max_torque()));
  }
  released_ = false;
  if (fading_.done() && fading_torque_.done()) return;
  result_.bits |= kForceSurfaceRamp;
  force = limited(Vec3d(force - fading_.remaining()), max_force());
  torque = limited(Vec3d(torque - fading_torque_.remaining()), max_torque());
}

void ForceRenderer::limit(const Vec3d& force, const Vec3d& torque, double pose_age, double dt) noexcept {
  advance_gain(pose_age, dt);
  const bool felt = !force.isZero(0) || !torque.isZero(0);
  Vec3d limited_force = limited(force, max_force()), limited_torque = limited(torque, max_torque());
  // A device without torque sets no bit for a missing torque.
  if (limited_force != force || (max_torque() > 0 && limited_torque != torque)) result_.bits |= kForceSaturated;
  fade(limited_force, limited_torque, dt);
  if (gain_ < 1 && felt) result_.bits |= kForceSoftStart;
  const Vec3d wanted = limited_force * gain_, wanted_torque = limited_torque * gain_;
  Vec3d out = slewed(wanted, result_.force, settings_.max_slew * dt);
  Vec3d out_torque = slewed(wanted_torque, result_.torque, settings_.max_torque_slew * dt);
  if (out != wanted || out_torque != wanted_torque) result_.bits |= kForceSlewLimited;
  if (pose_age >= settings_.zero_force_age - kAgeTolerance) {
    out.setZero();
    out_torque.setZero();
  }
  if (!out.allFinite() || !out_torque.allFinite()) return latch(Fault::kForceNotFinite);
  result_.force = out;
  result_.torque = out_torque;
}

}  // namespace tactus::haptics
