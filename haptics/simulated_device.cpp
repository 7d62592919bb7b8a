#include "haptics/simulated_device.hpp"

#include <algorithm>
#include <cmath>

#include "haptics/rigid_body.hpp"

namespace tactus::haptics {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::int64_t kSubstepNs = 250'000;
constexpr std::int64_t kLongestGapNs = 50'000'000;

Vec3d vector_of(const std::array<double, 3>& a) noexcept { return {a[0], a[1], a[2]}; }
Eigen::Quaterniond quaternion_of(const std::array<double, 4>& q) noexcept { return {q[3], q[0], q[1], q[2]}; }

}  // namespace

HandPath::Segment HandPath::segment_at(std::int64_t time_ns) const noexcept {
  const Waypoint* const end = waypoints.data() + count;
  const Waypoint* const next =
      std::find_if(waypoints.data(), end, [&](const Waypoint& waypoint) { return waypoint.time_ns > time_ns; });
  if (next == waypoints.data() || next == end) {
    const Waypoint* const only = next == end ? next - 1 : next;
    return {only, only, 0, 0};
  }
  const Waypoint* const before = next - 1;
  const double span = static_cast<double>(next->time_ns - before->time_ns);
  return {before, next, static_cast<double>(time_ns - before->time_ns) / span, 1e9 / span};
}

void HandPath::at(std::int64_t time_ns, Vec3d& position, Vec3d& velocity) const noexcept {
  const Segment segment = segment_at(time_ns);
  const Vec3d difference = vector_of(segment.to->position) - vector_of(segment.from->position);
  position = vector_of(segment.from->position) + difference * segment.share;
  velocity = difference * segment.rate;
}

Eigen::Quaterniond HandPath::orientation_at(std::int64_t time_ns) const noexcept {
  const Segment segment = segment_at(time_ns);
  const Eigen::Quaterniond from = quaternion_of(segment.from->orientation);
  if (segment.from->orientation == segment.to->orientation) return from;
  return from.slerp(segment.share, quaternion_of(segment.to->orientation)).normalized();
}

SimulatedDevice::SimulatedDevice(const HandSettings& settings, const DeviceSpec& spec)
    : spec_{spec},
      settings_{settings},
      random_{settings.seed},
      position_{settings.start},
      orientation_{settings.start_orientation},
      measured_position_{settings.start} {
  std::uniform_real_distribution<double> frequency{2 * kPi * 8, 2 * kPi * 12};
  std::uniform_real_distribution<double> phase{0, 2 * kPi};
  for (auto& axis : tremor_) {
    for (Tone& tone : axis) tone = {frequency(random_), phase(random_)};
  }
}

Vec3d SimulatedDevice::tremor_at(std::int64_t time_ns) const noexcept {
  // kTones sines of amplitude A have a root mean square of A sqrt(kTones / 2) on each axis, times sqrt(3) in space.
  const double amplitude = settings_.tremor / std::sqrt(1.5 * kTones);
  const double time = static_cast<double>(time_ns) * 1e-9;
  Vec3d shake = Vec3d::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    for (const Tone& tone : tremor_[axis]) shake[axis] += std::sin(tone.frequency * time + tone.phase);
  }
  return amplitude * shake;
}

Vec3d SimulatedDevice::measured() noexcept {
  Vec3d reading = position_;
  if (settings_.noise > 0) {
    std::normal_distribution<double> noise{0, settings_.noise};
    for (int axis = 0; axis < 3; ++axis) reading[axis] += noise(random_);
  }
  if (settings_.encoder_step > 0) {
    for (int axis = 0; axis < 3; ++axis) {
      reading[axis] = std::round(reading[axis] / settings_.encoder_step) * settings_.encoder_step;
    }
  }
  return reading;
}

DeviceState SimulatedDevice::read(std::int64_t now_ns) noexcept {
  if (HandPath path; paths_.take(path) && path.count > 0) path_ = path;
  if (!started_) {
    started_ = true;
    time_ns_ = now_ns;
    measured_position_ = measured();
  }
  const std::int64_t elapsed = now_ns - time_ns_;
  time_ns_ = std::max(time_ns_, now_ns - kLongestGapNs);
  while (time_ns_ < now_ns) {
    const std::int64_t step_ns = std::min(kSubstepNs, now_ns - time_ns_);
    time_ns_ += step_ns;
    const double step = static_cast<double>(step_ns) * 1e-9;
    Vec3d target = settings_.start;
    Vec3d target_velocity = Vec3d::Zero();
    Eigen::Quaterniond orientation = settings_.start_orientation;
    if (path_.count > 0) {
      path_.at(time_ns_, target, target_velocity);
      orientation = path_.orientation_at(time_ns_);
    }
    if (settings_.tremor > 0) target += tremor_at(time_ns_);
    const Vec3d pull = settings_.hand_stiffness * (target - position_) + settings_.hand_damping * target_velocity;
    // Integrates the dampers implicitly and the spring explicitly, and the position with the new velocity.
    const double dampers = spec_.damping + settings_.hand_damping;
    velocity_ = (velocity_ + step / settings_.mass * (pull + force_)) / (1 + step / settings_.mass * dampers);
    position_ += step * velocity_;
    const Vec3d twist = settings_.wrist_stiffness * log_map(orientation * orientation_.conjugate()) + torque_;
    angular_velocity_ = (angular_velocity_ + step / settings_.inertia * twist) /
                        (1 + step / settings_.inertia * settings_.wrist_damping);
    orientation_ = (exp_map(step * angular_velocity_) * orientation_).normalized();
  }

  if (elapsed > 0) {
    const Vec3d reading = measured();
    // A real device measures positions only; the velocity is their smoothed difference.
    constexpr double kSmoothing = 3e-3;
    const double seconds = static_cast<double>(elapsed) * 1e-9;
    const Vec3d change = (reading - measured_position_) / seconds;
    measured_velocity_ += (change - measured_velocity_) * (seconds / (kSmoothing + seconds));
    measured_position_ = reading;
  }
  DeviceState state;
  state.position = measured_position_;
  state.velocity = measured_velocity_;
  state.orientation = orientation_;
  state.buttons = path_.buttons;
  state.time_ns = now_ns;
  return state;
}

}  // namespace tactus::haptics
