#include "hrtc_service/user_devices.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "realtime/periodic_clock.hpp"
#include "session/figures.hpp"
#include "sharing/hand_path.hpp"

namespace tactus::hrtc_service {

UserDevices::UserDevices(wire::Participants& participants, DeviceLink& link, OnIntent on_intent)
    : participants_{participants},
      link_{link},
      orders_out_{link.orders},
      orders_{MailboxReader{link.orders}.latest()},
      on_intent_{std::move(on_intent)} {
  for (const ProbeOrder& order : orders_) users_added_ = std::max(users_added_, order.user);
}
UserDevices::~UserDevices() = default;

std::array<std::uint64_t, kMaxProbes> UserDevices::users_in(const DeviceLink& link) {
  std::array<std::uint64_t, kMaxProbes> users{};
  const ProbeOrders orders = MailboxReader{link.orders}.latest();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) users[i] = orders[i].user_id;
  return users;
}

void UserDevices::remove_earlier_users() {
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (orders_[i].user_id != 0 && users_.count(i) == 0) order(i, {});
}

void UserDevices::order(std::uint32_t probe, const ProbeOrder& order) {
  orders_[probe] = order;
  orders_out_.post(orders_);
}

void UserDevices::add_local(std::uint32_t probe, const std::string& name) {
  User& user = users_[probe];
  user.name = name;
  user.id = session::id_of(name);
  user_ids_[probe] = user.id;
}

void UserDevices::add(std::uint32_t probe, const std::string& name, std::uint64_t client) {
  User& user = users_[probe];
  user.name = name;
  user.id = session::id_of(name);
  user.client = client;
  if (orders_[probe].user_id != user.id) order(probe, {.user = ++users_added_, .user_id = user.id});
  user.number = orders_[probe].user;
  user_ids_[probe] = user.id;
  user.intents = std::make_unique<wire::Reader<session::Intent>>(participants_, wire::topics::kIntent, on_intent_,
                                                                 wire::EndpointOptions{wire::user_partition(name)});
  listen_to_device(probe, user);
}

/// Opens the reader of a client's device poses. Its callback passes the poses to the haptic thread directly, without a
/// delay by the service thread.
void UserDevices::listen_to_device(std::uint32_t probe, User& user) {
  user.remote = std::make_unique<haptics::RemoteTiming>();
  const auto on_pose = [this, remote = user.remote.get(), id = user.id, client = user.client, number = user.number,
                        out = MailboxWriter{link_.poses[probe]},
                        window =
                            session::SenderWindow{session::kCycleNumbers}](const session::DevicePose& pose) mutable {
    if (pose.user_id != id || pose.origin.participant != client) return;
    const std::int64_t now_ns = realtime::monotonic_ns();
    const session::Admission admission = window.admit(pose.origin, pose.sequence, now_ns);
    if (admission == session::Admission::kImplausible) implausible_.fetch_add(1, std::memory_order_relaxed);
    if (!session::accepted(admission)) return;
    haptics::RemotePose remote_pose;
    remote_pose.position = pose.pose.position;
    remote_pose.orientation = pose.pose.orientation;
    remote_pose.velocity = pose.velocity;
    remote_pose.sequence = pose.sequence;
    remote_pose.buttons = pose.buttons;
    remote_pose.command_applied = pose.command_applied;
    remote_pose.measured_ns = pose.session_time_ns - session_offset_ns_.load(std::memory_order_relaxed);
    remote_pose.arrived_ns = now_ns;
    out.post({number, remote->on_pose(remote_pose)});
  };
  user.poses = std::make_unique<wire::Reader<session::DevicePose>>(
      participants_, wire::topics::kDevicePose, on_pose, wire::EndpointOptions{wire::user_partition(user.name)});
}

void UserDevices::remove(std::uint32_t probe) {
  const auto at = users_.find(probe);
  if (at == users_.end()) return;
  User& user = at->second;
  order(probe, {});
  remote_endpoints_[probe] = {};
  const std::uint64_t remotes = remote_endpoints_out_.post(remote_endpoints_);
  user_ids_[probe] = 0;
  user.intents.reset();
  user.poses.reset();
  departed_users_.push_back({std::move(user), remotes});
  users_.erase(at);
  free_departed();
}

void UserDevices::free_departed() {
  departed_users_.erase(std::remove_if(departed_users_.begin(), departed_users_.end(),
                                       [this](const DepartedUser& departed) {
                                         return departed.user.commands == nullptr ||
                                                remote_endpoints_out_.is_adopted(departed.remotes);
                                       }),
                        departed_users_.end());
}

void UserDevices::on_intent(const session::Intent& intent, std::int64_t ahead_ns) {
  for (auto& [probe, user] : users_) {
    if (user.id != intent.user_id || user.client != intent.origin.participant || intent.path.empty()) continue;
    if (orders_[probe].source == PoseSource::kRemote) continue;
    if (orders_[probe].source == PoseSource::kNone) {
      const session::Pose& start = intent.path.front().pose;
      order(probe, {PoseSource::kHand, probe + 1, user.number, user.id, start.position, start.orientation});
    }
    MailboxWriter{link_.paths[probe]}.post({user.number, sharing::hand_path(intent, ahead_ns)});
  }
}

void UserDevices::open_remote_devices() {
  for (auto& [probe, user] : users_) {
    if (user.remote == nullptr || !user.remote->has_pose() || user.commands != nullptr ||
        orders_[probe].source == PoseSource::kHand)
      continue;
    user.commands = std::make_unique<wire::Writer<session::DeviceCommand>>(
        participants_, wire::topics::kDeviceCommand, wire::EndpointOptions{wire::user_partition(user.name)});
    remote_endpoints_[probe] = {user.remote.get(), user.id, user.commands.get()};
    remote_endpoints_out_.post(remote_endpoints_);
    order(probe, {.source = PoseSource::kRemote, .user = user.number, .user_id = user.id});
    spdlog::info("user {} has a remote device", user.name);
  }
}

void UserDevices::add_figures(std::vector<session::Figure>& figures) const {
  namespace names = session::figures;
  double remotes = 0, round_trip = 0;
  for (const auto& [probe, user] : users_) {
    if (orders_[probe].source != PoseSource::kRemote) continue;
    ++remotes;
    round_trip = std::max(round_trip, user.remote->round_trip());
  }
  figures.push_back({names::kRemoteDevices, remotes});
  figures.push_back({names::kDeviceRoundTrip, round_trip * 1e6});
}

void UserDevices::send_commands(const ProbeReports& latest) {
  const RemoteEndpoints& endpoints = remote_endpoints_out_.latest();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const RemoteEndpoint& endpoint = endpoints[i];
    const ProbeOutput& probe = latest.probes[i];
    if (endpoint.device == nullptr || !probe.active) continue;
    session::DeviceCommand command;
    command.origin = participants_.origin();
    command.user_id = endpoint.user_id;
    command.probe = i;
    command.sequence = endpoint.device->on_command(latest.time_ns);
    command.pose_answered = probe.pose_sequence;
    command.force = probe.force;
    command.torque = probe.torque;
    command.normal = probe.normal;
    command.status = probe.status;
    command.error_bound = probe.error_bound;
    command.data_age_us = age_us(probe);
    (void)endpoint.commands->send(command);
  }
}

}  // namespace tactus::hrtc_service
