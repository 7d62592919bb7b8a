#include "hrtc_service/servo/probe_devices.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "haptics/force.hpp"
#include "hrtc_service/servo/shared_check.hpp"

namespace tactus::hrtc_service {
namespace {

template <class Probe, std::size_t... kNumbers>
std::array<Probe, sizeof...(kNumbers)> make_probes(DeviceLink& link, const LocalDevices& local,
                                                   const haptics::DeviceFrame& frame,
                                                   std::index_sequence<kNumbers...>) {
  return {Probe{link, kNumbers, local[kNumbers], frame}...};
}

}  // namespace

ProbeDevices::ProbeDevices(DeviceLink& link, const LocalDevices& local, const haptics::DeviceFrame& frame,
                           const HandLimits& limits)
    : limits_{limits},
      orders_{link.orders},
      probes_{make_probes<Probe>(link, local, frame, std::make_index_sequence<kMaxProbes>{})} {}

/// Begins with a new device if the order is for another user or source. Returns whether this replaces a device. No
/// memory is allocated.
bool ProbeDevices::obey(Probe& probe, const ProbeOrder& order) noexcept {
  const PoseSource source = is_valid(order) ? order.source : PoseSource::kNone;
  if (source == probe.order.source && order.user == probe.order.user) return false;
  const bool is_replaced = probe.order.source != PoseSource::kNone;
  probe.order = order;
  probe.order.source = source;
  probe.has_pose = false;
  probe.hand.reset();
  if (source != PoseSource::kHand) return is_replaced;
  haptics::HandSettings settings;
  settings.start = vec(order.start);
  settings.start_orientation = quaternion(order.orientation);
  settings.seed = order.seed;
  probe.hand.emplace(settings);
  return is_replaced;
}

/// A path may arrive before the order for its user, so the newest one is kept.
void ProbeDevices::take_path(Probe& probe) noexcept {
  if (probe.paths.take(probe.path)) probe.is_path_new = is_valid(probe.path.path);
  if (!probe.is_path_new || !probe.hand || probe.path.user != probe.order.user) return;
  probe.is_path_new = false;
  probe.hand->paths().post(probe.path.path);
}

void ProbeDevices::take_pose(Probe& probe, std::int64_t now_ns) noexcept {
  const UserPose& newest = probe.poses.latest();
  if (newest.user != probe.order.user || !is_valid(newest.pose) || newest.pose.pose.arrived_ns > now_ns) return;
  probe.pose = haptics::state_of(newest.pose);
  probe.has_pose = true;
}

void ProbeDevices::read_local(Probe& probe, std::int64_t now_ns, ProbeInput& input) const noexcept {
  const haptics::DeviceState device = probe.local->read(now_ns);
  // In the world, a device of a small scale is slow.
  const bool is_too_fast =
      probe.frame.scale() < 1 && !probe.written.isZero(0) && device.velocity.norm() > limits_.max_speed;
  input.failed = is_too_fast || probe.local->health() == haptics::DeviceHealth::kFailed;
  input.pose_age = static_cast<double>(now_ns - device.time_ns) * 1e-9;
  const bool is_clutched = (device.buttons & haptics::kClutchButton) != 0;
  probe.strength = is_clutched ? 0 : std::min(1.0, probe.strength + limits_.period / limits_.rise_time);
  input.device = probe.frame.to_world(device, is_clutched);
}

void ProbeDevices::read(std::int64_t now_ns, std::array<ProbeInput, kMaxProbes>& inputs) noexcept {
  const ProbeOrders& orders = orders_.latest();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    Probe& probe = probes_[i];
    ProbeInput& input = inputs[i];
    input.active = true;
    input.failed = false;
    if (probe.local != nullptr) {
      read_local(probe, now_ns, input);
      continue;
    }
    const bool is_replaced = obey(probe, orders[i]);
    take_path(probe);
    take_pose(probe, now_ns);
    input.active = !is_replaced && (probe.hand || (probe.order.source == PoseSource::kRemote && probe.has_pose));
    if (!input.active) continue;
    input.device = probe.hand ? probe.hand->read(now_ns) : probe.pose;
    input.pose_age = static_cast<double>(now_ns - input.device.time_ns) * 1e-9;
  }
}

/// The force is zero while the clutch is down. In the world it may be at its limits when the clutch is released.
void ProbeDevices::write_local(Probe& probe, const ProbeOutput& output) const noexcept {
  const Vec3d force = vec(output.force), torque = vec(output.torque);
  const bool has_fault = (output.status & session::kFault) != 0;
  Vec3d at_hand = probe.strength * probe.frame.force_to_device(force);
  if (const double size = at_hand.norm(); !(size <= limits_.max_force)) at_hand *= limits_.max_force / size;
  if (probe.frame.scale() > 1 && probe.strength > 0 && !has_fault)
    at_hand = haptics::slewed(at_hand, probe.written, limits_.max_slew * limits_.period);
  if (!at_hand.allFinite()) at_hand.setZero();  // the force, or a limit, is not finite
  probe.written = at_hand;
  probe.local->write_wrench(at_hand, probe.strength * probe.frame.torque_to_device(torque));
}

void ProbeDevices::write(const std::array<ProbeOutput, kMaxProbes>& outputs) noexcept {
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    Probe& probe = probes_[i];
    if (probe.local != nullptr)
      write_local(probe, outputs[i]);
    else if (probe.hand)
      probe.hand->write_wrench(vec(outputs[i].force), vec(outputs[i].torque));
  }
}

void ProbeDevices::release() noexcept {
  for (Probe& probe : probes_)
    if (probe.local != nullptr) probe.local->write_wrench(Vec3d::Zero(), Vec3d::Zero());
}

}  // namespace tactus::hrtc_service
