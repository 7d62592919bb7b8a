#include "client_sim/remote_hand.hpp"

#include <algorithm>
#include <utility>

#include "realtime/realtime.hpp"
#include "sharing/hand_path.hpp"

namespace tactus::client_sim {
namespace {

constexpr double kHold = 0.010, kZeroBy = 0.060;  // s without a command; the same values as in haptics::ForceSettings
constexpr int kPriority = 40;

}  // namespace

RemoteHand::RemoteHand(wire::Participants& participants, const RemoteHandSettings& settings)
    : participants_{participants},
      settings_{settings},
      user_id_{session::id_of(settings.user)},
      hrtc_id_{session::id_of(settings.hrtc)},
      device_{settings.hand},
      poses_{participants, wire::topics::kDevicePose, wire::EndpointOptions{wire::user_partition(settings.user)}},
      commands_{participants, wire::topics::kDeviceCommand,
                [this](session::DeviceCommand&& command) { on_command(command); },
                wire::EndpointOptions{wire::user_partition(settings.user)}},
      thread_{[this] { run(); }} {}

RemoteHand::~RemoteHand() {
  running_ = false;
  thread_.join();
}

void RemoteHand::set_intent(const session::Intent& intent, const session::ClockMap& map) {
  clock_.post(map);
  const std::int64_t now_ns = realtime::monotonic_ns();
  device_.paths().post(sharing::hand_path(intent, now_ns - map.session_time(now_ns)));
}

void RemoteHand::on_command(const session::DeviceCommand& command) {
  if (command.user_id != user_id_ || command.origin.participant != hrtc_id_) return;
  const std::int64_t now_ns = realtime::monotonic_ns();
  const session::Admission admission = commands_seen_.admit(command.origin, command.sequence, now_ns);
  if (admission == session::Admission::kImplausible) implausible_.fetch_add(1, std::memory_order_relaxed);
  if (!session::accepted(admission)) return;
  command_.post({command.force, command.torque, command.sequence, now_ns});
}

void RemoteHand::run() {
  pthread_setname_np(pthread_self(), "remote hand");
  // A refusal is no error, because poses that are late only reduce the stiffness.
  (void)realtime::enter_realtime("remote hand", kPriority);
  const auto period_ns = static_cast<std::int64_t>(1e9 / settings_.rate);
  std::int64_t due_ns = realtime::monotonic_ns();
  session::DevicePose pose;
  pose.user_id = user_id_;
  pose.radius = settings_.radius;
  while (running_) {
    due_ns = std::max(due_ns + period_ns, realtime::monotonic_ns());
    realtime::sleep_until(due_ns);
    const std::int64_t now_ns = realtime::monotonic_ns();
    const ReceivedCommand& command = command_.latest();
    const double command_age = static_cast<double>(now_ns - command.arrived_ns) * 1e-9;
    const double share = std::clamp((kZeroBy - command_age) / (kZeroBy - kHold), 0.0, 1.0);
    device_.write_wrench(share * haptics::Vec3d{command.force[0], command.force[1], command.force[2]},
                         share * haptics::Vec3d{command.torque[0], command.torque[1], command.torque[2]});
    const haptics::DeviceState state = device_.read(now_ns);
    pose.origin = participants_.origin();
    ++pose.sequence;
    pose.session_time_ns = clock_.latest().session_time(now_ns);
    pose.pose.position = {state.position.x(), state.position.y(), state.position.z()};
    pose.pose.orientation = {state.orientation.x(), state.orientation.y(), state.orientation.z(),
                             state.orientation.w()};
    pose.velocity = {state.velocity.x(), state.velocity.y(), state.velocity.z()};
    pose.buttons = state.buttons;
    pose.command_applied = command.sequence;
    (void)poses_.send(pose);
  }
}

}  // namespace tactus::client_sim
