/// From proxy and device to a force that is safe to feel.
///
/// force = stiffness (anchor - device) - damping * velocity along the contact normal, relative to what is touched, then
/// limited. Every limit that acts sets its bit, so that an operator can be told.
///
/// When the surface has changed, the force goes on as it would have without: the difference between the two, whatever
/// it comes from, is taken off and let through at a steady rate. So there is no step, and the force is soon the one of
/// the surface. Meanwhile it may push less or more than that would, but not pull the hand in.
///
/// A tool has a torque too: stiffness times way, torsion times turn (haptics/tool.hpp, which sees to it that neither
/// jumps when a surface changes). Each of the two is limited by itself; the bits are those of either.
///
/// World frame, SI. One thread at a time. Realtime. Rules and tests: docs/explanation/safety.md.
#pragma once

#include <algorithm>
#include <cstdint>

#include "haptics/device.hpp"
#include "haptics/proxy.hpp"
#include "haptics/ramp.hpp"
#include "haptics/tool.hpp"

namespace tactus::haptics {

/// A place on something that moves, which a hand holds on to with all six degrees of freedom. World frame.
struct Hold {
  ToolPose pose;                           ///< that the device is pulled to
  Vec3d velocity = Vec3d::Zero();          ///< of that place, m/s
  Vec3d angular_velocity = Vec3d::Zero();  ///< of the object, rad/s
};

struct Wrench {
  Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();  ///< N; N m about the tip
};

/// What acted on a force, and why; a cycle's bits are or-ed. kForceBits of them.
enum ForceBit : std::uint32_t {
  kForceSaturated = 1u << 0,     ///< |force| was above the limit
  kForceSlewLimited = 1u << 1,   ///< it changed faster than allowed
  kForceSoftStart = 1u << 2,     ///< not yet at full strength after start, reset or stale data
  kForceStale = 1u << 3,         ///< the pose is too old; the force is on its way to zero
  kForceSurfaceRamp = 1u << 4,   ///< a surface that moved past the proxy is felt little by little
  kForceStiffnessCut = 1u << 5,  ///< the material is stiffer than this device can render stably
  kForceFault = 1u << 6          ///< latched: zero until reset
};
constexpr std::uint32_t kForceBits = 7;

/// Why a force is off until reset. The numbers go over the network (session::fault_of).

enum class Fault : std::uint8_t {
  kNone = 0,
  kInputNotFinite = 1,  ///< a pose, velocity or surface figure was NaN or infinite
  kForceNotFinite = 2,  ///< the force would have been
  kDeviceFailed = 3,    ///< DeviceHealth::kFailed
  kEmergencyStop = 4,
  kTooFast = 5  ///< the tip moved faster than ForceSettings::max_speed while a force acted on it
};

/// N/s: how fast what a change of the surface does to the force is let through.
inline constexpr double kSurfaceRamp = 45;

struct ForceSettings {
  double max_force = 8;     ///< N; the device's own limit holds too
  double max_slew = 5000;   ///< N/s
  double soft_start = 0.5;  ///< s from zero to full strength
  double recovery = 0.1;    ///< s from zero to full strength once poses are fresh again
  double hold = 0.010;      ///< s for which an old pose still counts
  double zero_by = 0.060;   ///< s of age at which the force is zero
  /// m/s, as the device tells it and as its positions do. A hand does not move so fast against a force, a device that
  /// has come loose does; in the air nothing is tripped.
  double max_speed = 1.5;
  double max_torque = 0.3;           ///< N m; the device's own limit holds too
  double max_torque_slew = 150;      ///< N m/s
  double max_angular_velocity = 40;  ///< rad/s, as its orientations tell it; as max_speed
};

/// How the touched object feels along its normal.
struct Feel {
  double stiffness = 1000;  ///< N/m
  double damping = 1;       ///< N s/m
};

struct ForceResult {
  Vec3d force = Vec3d::Zero();   ///< on the user's hand
  Vec3d torque = Vec3d::Zero();  ///< the same, about the tip; zero without a tool
  std::uint32_t bits = 0;        ///< ForceBit
  std::uint32_t began = 0;       ///< those that the step before did not have
  Fault fault = Fault::kNone;
};

/// From the device to what it holds, rad along the axis.
[[nodiscard]] Vec3d turn_to(const Hold& hold, const DeviceState& device) noexcept;
/// What springs and dampers of a hold exert on the hand before limits, on a device that turns with `spin`.
[[nodiscard]] Wrench pull_of(const Hold& hold, const ToolGrip& grip, double damping, const DeviceState& device,
                             const Vec3d& angular_velocity) noexcept;

/// The stiffness that stays stable on a device of damping b: (b + B) / (T / 2 + td), with B the virtual damping, T the
/// cycle and td the loop's further delay. Source: Hulin, Preusche, Hirzinger 2006; 5-45 % conservative.
[[nodiscard]] constexpr double stable_stiffness(double device_damping, double damping, double cycle,
                                                double loop_delay) noexcept {
  return (device_damping + damping) / (cycle / 2 + loop_delay);
}

class ForceRenderer {
 public:
  /// `spec` in world units (DeviceFrame::to_world).
  ForceRenderer(const ForceSettings& settings, const DeviceSpec& spec) noexcept : settings_{settings}, spec_{spec} {}

  /// What is left of a material's stiffness on this device, at cycles of `dt` seconds and with DeviceState::loop_delay.
  /// Give it to the proxy's grip too.
  [[nodiscard]] double stiffness(const Feel& feel, double dt, double loop_delay = 0) const noexcept;

  /// The same for a tool, by which its coupling is to be held; 1,000 N/m go with 0.1 N m/rad.
  [[nodiscard]] ToolGrip grip(const Feel& feel, double dt, double loop_delay = 0) const noexcept;
  /// The same for what a hand holds, as with fingers 10 cm apart: 1,000 N/m go with 2.5 N m/rad.
  [[nodiscard]] ToolGrip hold(const Feel& feel, double dt, double loop_delay = 0) const noexcept;

  /// One cycle of `dt` seconds. `pose_age`: seconds since the device was where `device` says, without its transit.
  /// `unchanged`: where the proxy would be had the surface not changed in this cycle (Proxy::unchanged); null: there.
  /// Whatever comes in, the force is finite and within its limits, and zero from the first fault on.
  [[nodiscard]] const ForceResult& step(const ProxyResult& proxy, const DeviceState& device, const Feel& feel,
                                        double pose_age, double dt, const ProxyResult* unchanged = nullptr) noexcept;
  /// The same of a tool that was held by `grip`.
  [[nodiscard]] const ForceResult& step(const ToolResult& tool, const ToolGrip& grip, const DeviceState& device,
                                        const Feel& feel, double pose_age, double dt) noexcept;

  /// The same of a hand that holds something by `grip`.
  [[nodiscard]] const ForceResult& step(const Hold& hold, const ToolGrip& grip, const DeviceState& device,
                                        const Feel& feel, double pose_age, double dt) noexcept;
  /// Of the device as its orientations tell it, smoothed; rad/s.
  [[nodiscard]] const Vec3d& angular_velocity() const noexcept { return angular_velocity_; }
  /// Share of full strength: below 1 while forces start softly or poses are old.
  [[nodiscard]] double strength() const noexcept { return gain_; }
  [[nodiscard]] bool bears_torque() const noexcept { return max_torque() > 0; }

  /// Zero force from now on. The first fault since the reset is the one reported.
  void latch(Fault fault) noexcept;

  /// Ends a fault; the force starts softly again.
  void reset() noexcept;

 private:
  void render(const ProxyResult& proxy, const DeviceState& device, const Feel& feel, double pose_age, double dt,
              const ProxyResult* unchanged) noexcept;
  void render(const ToolResult& tool, const ToolGrip& grip, const DeviceState& device, const Feel& feel,
              double pose_age, double dt) noexcept;
  void render(const Hold& hold, const ToolGrip& grip, const DeviceState& device, const Feel& feel, double pose_age,
              double dt) noexcept;
  [[nodiscard]] ToolGrip grip_with(double arm, const Feel& feel, double dt, double loop_delay) const noexcept;
  [[nodiscard]] const ForceResult& reported() noexcept;
  /// False when a fault is latched: one of these is no number, or the device is too fast.
  [[nodiscard]] bool admit(const DeviceState& device, const Feel& feel, double pose_age, double dt) noexcept;
  /// What the limits leave of a force and a torque.
  void limit(const Vec3d& force, const Vec3d& torque, double pose_age, double dt) noexcept;
  [[nodiscard]] Vec3d slewed(const Vec3d& wanted, const Vec3d& before, double largest) noexcept;
  [[nodiscard]] double max_force() const noexcept { return std::min(settings_.max_force, spec_.max_force); }
  [[nodiscard]] double max_torque() const noexcept { return std::min(settings_.max_torque, spec_.max_torque); }
  /// What is felt of what presses while a ramp is under way.
  [[nodiscard]] Vec3d ramped(const Vec3d& pressed, const Vec3d& normal) noexcept;
  void advance_gain(double pose_age, double dt) noexcept;
  [[nodiscard]] bool too_fast(const DeviceState& device, double dt) noexcept;

  ForceSettings settings_;
  DeviceSpec spec_;
  ForceResult result_;
  double gain_ = 0;        // share of full strength
  double rise_time_ = -1;  // s from zero to full strength; < 0: as at the start
  std::uint32_t bits_before_ = 0;
  Ramp ramp_;                   // N
  Vec3d last_ = Vec3d::Zero();  // N, as ramped, before the limits
  bool placed_ = false;         // the next three are known
  Vec3d position_ = Vec3d::Zero();
  Eigen::Quaterniond orientation_ = Eigen::Quaterniond::Identity();
  std::int64_t time_ns_ = 0;
  Vec3d angular_velocity_ = Vec3d::Zero();
};

}  // namespace tactus::haptics
