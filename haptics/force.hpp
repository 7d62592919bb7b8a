/// Computes a safe force from proxy and device.
///
/// The force is stiffness * (anchor - device), minus damping times the device's velocity along the contact normal,
/// relative to the touched surface. Then the force is limited. Every limit that acts sets a bit, so that an operator
/// can see it.
///
/// When the surface changes, the force first continues as if the surface had not changed. Then it moves at a constant
/// rate to the force of the changed surface. So the force does not jump. During this surface ramp it may push more or
/// less than the changed surface would, but it never pulls the hand in.
///
/// A tool also exerts a torque: rotational stiffness times rotation. The force of a tool needs no surface ramp, because
/// haptics/tool.hpp prevents jumps of displacement and rotation. Force and torque have separate limits, but share the
/// bits.
///
/// World frame, SI. One thread at a time. Realtime. docs/explanation/safety.md lists the rules and their tests.
#pragma once

#include <algorithm>
#include <cstdint>

#include "haptics/device.hpp"
#include "haptics/proxy.hpp"
#include "haptics/ramp.hpp"
#include "haptics/tool.hpp"

namespace tactus::haptics {

/// The frame of a held object to which the device is coupled in all six degrees of freedom. World frame.
struct Hold {
  ToolPose pose;                           ///< pose to which the device is pulled
  Vec3d velocity = Vec3d::Zero();          ///< m/s, of that frame
  Vec3d angular_velocity = Vec3d::Zero();  ///< rad/s, of the object
};

struct Wrench {
  Vec3d force = Vec3d::Zero();   ///< N
  Vec3d torque = Vec3d::Zero();  ///< N m, about the tip
};

/// Reasons why a force was changed; kForceBits bits. A report about several cycles has the bits of all these cycles.
enum ForceBit : std::uint32_t {
  kForceSaturated = 1u << 0,     ///< |force| was above the limit
  kForceSlewLimited = 1u << 1,   ///< the force would have changed faster than allowed
  kForceSoftStart = 1u << 2,     ///< not yet at full strength after start, reset or stale data
  kForceStale = 1u << 3,         ///< the pose is too old; the force is fading to zero
  kForceSurfaceRamp = 1u << 4,   ///< the force ramps because a surface changed or an object was withdrawn
  kForceStiffnessCut = 1u << 5,  ///< the material is stiffer than this device can render stably
  kForceFault = 1u << 6          ///< latched: zero until reset
};
constexpr std::uint32_t kForceBits = 7;

/// Reason why a force is off until a reset. Status bits carry these numbers (session::kFaultReason).
enum class Fault : std::uint8_t {
  kNone = 0,
  kInputNotFinite = 1,  ///< a pose, a velocity or a property of the surface was NaN or infinite
  kForceNotFinite = 2,  ///< the computed force was NaN or infinite
  kDeviceFailed = 3,    ///< DeviceHealth::kFailed
  kEmergencyStop = 4,
  kTooFast = 5,  ///< the tip moved faster than ForceSettings::max_speed while a force acted on it
  kOverload = 6  ///< the cycles took too long for stable forces
};
inline constexpr Fault kLastFault = Fault::kOverload;

/// N/s: rate of the surface ramp.
inline constexpr double kSurfaceRamp = 45;
/// N m/s: rate at which the torque of a withdrawn object fades.
inline constexpr double kTorqueRamp = 1.5;

struct ForceSettings {
  double max_force = 8;           ///< N; the device's own limit also applies
  double max_slew = 5000;         ///< N/s
  double soft_start = 0.5;        ///< s from zero to full strength
  double recovery = 0.1;          ///< s from zero to full strength once poses are fresh again
  double max_fresh_age = 0.010;   ///< s, age up to which a pose counts as fresh
  double zero_force_age = 0.060;  ///< s, age at which the force is zero
  /// m/s, limit of the device's velocity, and of the velocity computed from its positions. Above it, the force is
  /// switched off (Fault::kTooFast): no hand moves so fast against a force, but a device out of control does. Without a
  /// force there is no fault.
  double max_speed = 1.5;
  double max_torque = 0.3;           ///< N m; the device's own limit also applies
  double max_torque_slew = 150;      ///< N m/s
  double max_angular_velocity = 40;  ///< rad/s, limit like max_speed, computed from the device's orientations
};

/// Stiffness and damping of the touched object along the contact normal.
struct ContactImpedance {
  double stiffness = 1000;  ///< N/m
  double damping = 1;       ///< N s/m
};

struct ForceResult {
  Vec3d force = Vec3d::Zero();   ///< N, on the user's hand
  Vec3d torque = Vec3d::Zero();  ///< N m, about the tip; zero without a tool
  std::uint32_t bits = 0;        ///< ForceBit
  std::uint32_t began = 0;       ///< bits that the previous step did not set
  Fault fault = Fault::kNone;
};

/// Rotation vector from the device to the held frame, rad.
[[nodiscard]] Vec3d rotation_to(const Hold& hold, const DeviceState& device) noexcept;
/// Force and torque on the hand from the springs and dampers of a hold, before limits. `angular_velocity`: of the
/// device.
[[nodiscard]] Wrench wrench_of(const Hold& hold, const ToolGrip& grip, double damping, const DeviceState& device,
                               const Vec3d& angular_velocity) noexcept;

/// The maximum stable stiffness on a device with damping b: (b + B) / (T / 2 + td), with the virtual damping B, the
/// cycle T and the loop delay td, all in SI units. The formula is conservative: its result is 5 to 45 % lower than the
/// true maximum. Source: Hulin, Preusche, Hirzinger 2006.
[[nodiscard]] constexpr double stable_stiffness(double device_damping, double damping, double cycle,
                                                double round_trip) noexcept {
  return (device_damping + damping) / (cycle / 2 + round_trip);
}

/// The maximum damping that is stable on a device with the mass m: m / (T / 2 + td + tv), with the cycle T, the loop
/// delay td, and the delay tv of a device's velocity, all in SI units. A sampled damper is unstable above 2 m / T, a
/// delayed one above pi / 2 * m / td.
[[nodiscard]] constexpr double stable_damping(double device_mass, double cycle, double round_trip) noexcept {
  constexpr double kVelocityDelay = 0.002;  // s
  return device_mass / (cycle / 2 + round_trip + kVelocityDelay);
}

/// Returns `wanted`, or the closest vector to it whose difference from `before` has at most the length `max_change`.
[[nodiscard]] Vec3d slewed(const Vec3d& wanted, const Vec3d& before, double max_change) noexcept;

class ForceRenderer {
 public:
  /// `spec` in world units (DeviceFrame::to_world).
  ForceRenderer(const ForceSettings& settings, const DeviceSpec& spec) noexcept : settings_{settings}, spec_{spec} {}

  /// The impedance of a material with a damping that is stable on a device of 0.1 kg, at cycles of `dt` seconds and
  /// with DeviceState::round_trip. All functions below expect such an impedance.
  [[nodiscard]] static ContactImpedance with_stable_damping(const ContactImpedance& impedance, double dt,
                                                            double round_trip = 0) noexcept;

  /// The stiffness of a material after the limit for this device, N/m, at cycles of `dt` seconds and with
  /// DeviceState::round_trip. The proxy's grip needs the same value.
  [[nodiscard]] double stiffness(const ContactImpedance& impedance, double dt, double round_trip = 0) const noexcept;

  /// The coupling of a tool, limited like `stiffness`. At 1,000 N/m its rotational stiffness is 0.1 N m/rad.
  [[nodiscard]] ToolGrip tool_grip(const ContactImpedance& impedance, double dt, double round_trip = 0) const noexcept;
  /// The coupling of a held object, limited like `stiffness`. Its rotational stiffness is that of two fingers 10 cm
  /// apart: 2.5 N m/rad at 1,000 N/m.
  [[nodiscard]] ToolGrip hold_grip(const ContactImpedance& impedance, double dt, double round_trip = 0) const noexcept;

  /// Computes one cycle of `dt` seconds. `pose_age`: age of the device pose without its transit, s. `unchanged`: the
  /// result of Proxy::unchanged in a cycle in which the surface changed, otherwise null. For every input the force is
  /// finite and within its limits. After a fault it is zero.
  [[nodiscard]] const ForceResult& step(const ProxyResult& proxy, const DeviceState& device,
                                        const ContactImpedance& impedance, double pose_age, double dt,
                                        const ProxyResult* unchanged = nullptr) noexcept;
  /// Computes one cycle for a tool that is coupled by `grip`.
  [[nodiscard]] const ForceResult& step(const ToolResult& tool, const ToolGrip& grip, const DeviceState& device,
                                        const ContactImpedance& impedance, double pose_age, double dt) noexcept;

  /// Computes one cycle for a hand that holds an object, coupled by `grip`.
  [[nodiscard]] const ForceResult& step(const Hold& hold, const ToolGrip& grip, const DeviceState& device,
                                        const ContactImpedance& impedance, double pose_age, double dt) noexcept;
  /// Smoothed angular velocity of the device, computed from its orientations, rad/s.
  [[nodiscard]] const Vec3d& angular_velocity() const noexcept { return angular_velocity_; }
  /// Share of the full force: below 1 during a soft start and with old poses.
  [[nodiscard]] double strength() const noexcept { return gain_; }
  [[nodiscard]] bool has_torque() const noexcept { return max_torque() > 0; }

  /// Sets the force to zero until a reset. ForceResult states the first fault since the last reset.
  void latch(Fault fault) noexcept;

  /// Clears the fault; the force begins with a soft start.
  void reset() noexcept;

  /// Reports that the touched or held object is withdrawn in the next step: its force and torque then fade at
  /// kSurfaceRamp and kTorqueRamp.
  void release() noexcept { released_ = true; }

  /// Visits the state that one step leaves for the next, without the settings (haptics/carried.hpp). Values that only
  /// forces depend on may be any numbers, because forces are checked before they reach the hand. Realtime if `visit`
  /// is.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    static_assert(sizeof(ForceResult) == 64, "carry the new member");
    visit.number("force", result_.force), visit.number("torque", result_.torque);
    visit.any("force bits", result_.bits), visit.any("force bits that began", result_.began);
    visit.choice("fault", result_.fault, Fault::kNone, kLastFault);
    visit.number("strength", gain_), visit.number("rise time", rise_time_);
    visit.any("force bits before", bits_before_);
    Vec3d remaining = ramp_.remaining();
    visit.any("ramp", remaining);
    ramp_.set(remaining);
    visit.any("last force", last_);
    visit.flag("flag of a release", released_);
    for (Ramp* ramp : {&fading_, &fading_torque_}) {
      Vec3d fading = ramp->remaining();
      visit.any("fading force", fading);
      ramp->set(fading);
    }
    visit.flag("flag of a force", has_pose_);
    visit.any("device position", position_), visit.any("device orientation", orientation_);
    visit.any("device time", time_ns_), visit.any("angular velocity", angular_velocity_);
  }

  /// Limits of settings and device together, N and N m.
  [[nodiscard]] double max_force() const noexcept { return std::min(settings_.max_force, spec_.max_force); }
  [[nodiscard]] double max_torque() const noexcept { return std::min(settings_.max_torque, spec_.max_torque); }

 private:
  void render(const ProxyResult& proxy, const DeviceState& device, const ContactImpedance& impedance, double pose_age,
              double dt, const ProxyResult* unchanged) noexcept;
  void render(const ToolResult& tool, const ToolGrip& grip, const DeviceState& device,
              const ContactImpedance& impedance, double pose_age, double dt) noexcept;
  void render(const Hold& hold, const ToolGrip& grip, const DeviceState& device, const ContactImpedance& impedance,
              double pose_age, double dt) noexcept;
  [[nodiscard]] ToolGrip grip_with(double arm, const ContactImpedance& impedance, double dt,
                                   double round_trip) const noexcept;
  [[nodiscard]] const ForceResult& reported() noexcept;
  /// Latches a fault and returns false when an input is not finite or the device is too fast.
  [[nodiscard]] bool admit(const DeviceState& device, const ContactImpedance& impedance, double pose_age,
                           double dt) noexcept;
  /// Applies all limits to a force and a torque.
  void limit(const Vec3d& force, const Vec3d& torque, double pose_age, double dt) noexcept;
  /// Applies the surface ramp to a force.
  [[nodiscard]] Vec3d ramped(const Vec3d& pressed, const Vec3d& normal) noexcept;
  void fade(Vec3d& force, Vec3d& torque, double dt) noexcept;
  void advance_gain(double pose_age, double dt) noexcept;
  [[nodiscard]] bool too_fast(const DeviceState& device, double dt) noexcept;

  ForceSettings settings_;
  DeviceSpec spec_;
  ForceResult result_;
  double gain_ = 0;        // share of full strength
  double rise_time_ = -1;  // s from zero to full strength; < 0: ForceSettings::soft_start
  std::uint32_t bits_before_ = 0;
  Ramp ramp_;                    // N
  Vec3d last_ = Vec3d::Zero();   // N, force after the surface ramp, before the limits
  bool released_ = false;        // `release` was called since the last step
  Ramp fading_, fading_torque_;  // N, N m; force and torque of a withdrawn object
  bool has_pose_ = false;        // the next three are valid
  Vec3d position_ = Vec3d::Zero();
  Eigen::Quaterniond orientation_ = Eigen::Quaterniond::Identity();
  std::int64_t time_ns_ = 0;
  Vec3d angular_velocity_ = Vec3d::Zero();
};

}  // namespace tactus::haptics
