#include "haptics/remote_device.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::haptics {

void RoundTripBound::add(double seconds, double dt) noexcept {
  if (mean_ < 0) {
    mean_ = seconds;
    deviation_ = seconds / 2;
    value_ = mean_ + 4 * deviation_;
    return;
  }
  const double off = seconds - mean_;
  mean_ += off / 8;
  deviation_ += (std::abs(off) - deviation_) / 4;
  const double bound = mean_ + 4 * deviation_;
  value_ += (bound - value_) * (1 - std::exp(-dt / (bound > value_ ? kRise : kFall)));
}

TimedPose RemoteTiming::on_pose(RemotePose pose) noexcept {
  const double dt = started_ ? static_cast<double>(pose.arrived_ns - newest_ns_) * 1e-9 : 0;
  started_ = true;
  newest_ns_ = pose.arrived_ns;
  pose.measured_ns = std::clamp(pose.measured_ns, pose.arrived_ns - kMaxTransitNs, pose.arrived_ns);
  const std::uint32_t sent = commands_.load(std::memory_order_acquire);
  if (pose.command_applied != 0 && static_cast<std::int32_t>(sent - pose.command_applied) >= 0)
    round_trip_.add(static_cast<double>(pose.arrived_ns - sent_ns(pose.command_applied)) * 1e-9, dt);
  shown_round_trip_.store(round_trip_.value(), std::memory_order_relaxed);
  has_pose_.store(true, std::memory_order_release);
  return {pose, round_trip_.value()};
}

std::uint32_t RemoteTiming::on_command(std::int64_t cycle_ns) noexcept {
  const std::uint32_t number = commands_.load(std::memory_order_relaxed) + 1;
  sent_ns_[number % kStoredCommands].store(cycle_ns, std::memory_order_relaxed);
  commands_.store(number, std::memory_order_release);
  return number;
}

std::int64_t RemoteTiming::sent_ns(std::uint32_t command) const noexcept {
  // Meanwhile on_command may overwrite the oldest entries, so only the newest half is read. An older command gets the
  // time of the oldest entry of this half.
  const std::uint32_t sent = commands_.load(std::memory_order_acquire);
  const std::uint32_t kept = sent - std::min(sent - command, kStoredCommands / 2);
  return sent_ns_[kept % kStoredCommands].load(std::memory_order_relaxed);
}

DeviceState state_of(const TimedPose& timed) noexcept {
  const RemotePose& pose = timed.pose;
  DeviceState state;
  state.position = {pose.position[0], pose.position[1], pose.position[2]};
  state.velocity = {pose.velocity[0], pose.velocity[1], pose.velocity[2]};
  state.orientation = {pose.orientation[3], pose.orientation[0], pose.orientation[1], pose.orientation[2]};
  state.buttons = pose.buttons;
  state.time_ns = pose.measured_ns;
  state.sequence = pose.sequence;
  state.transit = static_cast<double>(pose.arrived_ns - pose.measured_ns) * 1e-9;
  state.round_trip = timed.round_trip;
  return state;
}

}  // namespace tactus::haptics
