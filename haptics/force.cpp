#include "haptics/force.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::haptics {
namespace {

constexpr double kRounding = 1e-9;  // s; ages are differences of times that may be long ago

/// What is within `limit` stays to the bit.
Vec3d limited(const Vec3d& force, double limit) noexcept {
  const double size = force.norm();
  return size > limit ? Vec3d(force * (limit / size)) : force;
}

/// What spring and damper of a contact make.
Vec3d pressing(const ProxyResult& proxy, const DeviceState& device, double stiffness, double damping) noexcept {
  Vec3d force = stiffness * (proxy.anchor - device.position);
  if (proxy.in_contact) {
    // Damping may cancel the push of the surface, not turn it into a pull.
    const double push = std::max(0.0, force.dot(proxy.normal));
    const double damped = std::max(-push, -damping * (device.velocity - proxy.surface_velocity).dot(proxy.normal));
    force += damped * proxy.normal;
  }
  return force;
}

}  // namespace

double ForceRenderer::stiffness(const Feel& feel, double dt, double loop_delay) const noexcept {
  return std::min({feel.stiffness, spec_.max_stiffness, stable_stiffness(spec_.damping, feel.damping, dt, loop_delay)});
}

void ForceRenderer::latch(Fault fault) noexcept {
  if (result_.fault == Fault::kNone) result_.fault = fault;
  result_.force.setZero();
  result_.bits = kForceFault;
}

void ForceRenderer::reset() noexcept { *this = ForceRenderer{settings_, spec_}; }

void ForceRenderer::advance_gain(double pose_age, double dt) noexcept {
  const double fresh = std::clamp((settings_.zero_by - pose_age) / (settings_.zero_by - settings_.hold), 0.0, 1.0);
  if (fresh < 1) {
    result_.bits |= kForceStale;
    // A stale pose before the soft start is over does not shorten that.
    if (gain_ >= 1) rise_time_ = settings_.recovery;
    gain_ = std::min(gain_, fresh);
    return;
  }
  if (gain_ < 1) {
    const double rise_time = rise_time_ < 0 ? settings_.soft_start : rise_time_;
    gain_ = rise_time > 0 ? std::min(1.0, gain_ + dt / rise_time) : 1.0;
  }
}

double ForceRenderer::speed_of(const DeviceState& device, double dt) noexcept {
  double speed = device.velocity.norm();
  if (placed_) {
    // A pose that is the one of before tells nothing, one that was late covers more than a cycle.
    const double passed = std::max(dt, static_cast<double>(device.time_ns - time_ns_) * 1e-9);
    speed = std::max(speed, (device.position - position_).norm() / passed);
  }
  placed_ = true;
  position_ = device.position;
  time_ns_ = device.time_ns;
  return speed;
}

const ForceResult& ForceRenderer::step(const ProxyResult& proxy, const DeviceState& device, const Feel& feel,
                                       double pose_age, double dt, const ProxyResult* unchanged) noexcept {
  if (result_.fault == Fault::kNone) render(proxy, device, feel, pose_age, dt, unchanged);
  result_.began = result_.bits & ~bits_before_;
  bits_before_ = result_.bits;
  return result_;
}

Vec3d ForceRenderer::ramped(const Vec3d& pressed, const Vec3d& normal) noexcept {
  if (ramp_.over()) return pressed;
  // What pushed before the change may pull on what is there now: that fades with the ramp, and never grows.
  const double most = std::max(0.0, -last_.dot(normal));
  const double pull = -(pressed - ramp_.left()).dot(normal);
  if (pull > most) ramp_.set(ramp_.left() - normal * (pull - most));
  return pressed - ramp_.left();
}

void ForceRenderer::render(const ProxyResult& proxy, const DeviceState& device, const Feel& feel, double pose_age,
                           double dt, const ProxyResult* unchanged) noexcept {
  const auto is_finite = [](const ProxyResult& at) { return at.anchor.allFinite() && at.normal.allFinite(); };
  const bool finite = is_finite(proxy) && (unchanged == nullptr || is_finite(*unchanged)) &&
                      device.position.allFinite() && device.velocity.allFinite() && std::isfinite(pose_age) &&
                      std::isfinite(feel.stiffness) && std::isfinite(feel.damping) && std::isfinite(dt) &&
                      std::isfinite(device.loop_delay);
  if (!finite) return latch(Fault::kInputNotFinite);
  const Vec3d before = result_.force;
  if (speed_of(device, dt) > settings_.max_speed && !before.isZero(0)) return latch(Fault::kTooFast);
  result_.bits = 0;

  const double stiffness = this->stiffness(feel, dt, device.loop_delay);
  const double limit = std::min(settings_.max_force, spec_.max_force);
  // Limited before it is ramped, too: what is beyond is not felt, and would take long.
  bool saturated = false;
  const auto pressed = [&](const ProxyResult& at) noexcept {
    const Vec3d whole = pressing(at, device, stiffness, feel.damping);
    const Vec3d within = limited(whole, limit);
    saturated = saturated || within != whole;
    return within;
  };
  Vec3d force = pressed(proxy);
  ramp_.advance(kSurfaceRamp * dt);
  const Vec3d without = unchanged != nullptr ? pressed(*unchanged) : force;
  if (unchanged == nullptr || (without == force && unchanged->normal == proxy.normal)) {
    force = ramped(force, proxy.normal);
  } else {
    const Vec3d goes_on = ramped(without, unchanged->normal);
    ramp_.set(force - goes_on);
    force = goes_on;
  }
  last_ = force;
  const bool felt = !force.isZero(0);
  if (felt && stiffness < feel.stiffness) result_.bits |= kForceStiffnessCut;
  if (!ramp_.over()) result_.bits |= kForceSurfaceRamp;

  advance_gain(pose_age, dt);
  const Vec3d within = limited(force, limit);
  if (saturated || within != force) result_.bits |= kForceSaturated;
  force = within;
  force *= gain_;
  if (gain_ < 1 && felt) result_.bits |= kForceSoftStart;
  const Vec3d change = force - before;
  const double largest = settings_.max_slew * dt;
  if (const double size = change.norm(); size > largest) {
    force = before + change * (largest / size);
    result_.bits |= kForceSlewLimited;
  }
  if (pose_age >= settings_.zero_by - kRounding) force.setZero();
  if (!force.allFinite()) return latch(Fault::kForceNotFinite);
  result_.force = force;
}

}  // namespace tactus::haptics
