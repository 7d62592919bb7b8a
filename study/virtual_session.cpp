#include "study/virtual_session.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "sharing/hand_path.hpp"
#include "study/constants.hpp"

namespace tactus::study {
namespace {

using spm::Vec3d;

constexpr std::uint64_t kHost = 10, kHrtc = 20;
constexpr std::int64_t kNetworkStepNs = 250'000;
constexpr std::uint64_t kSeedsPerRun = 64;
constexpr double kTremor = 1e-4;           // m rms, of a resting hand between 8 and 12 Hz
constexpr std::size_t kHeaderBytes = 170;  // of Ethernet, IP, UDP, RTPS and Tactus
constexpr std::size_t kPoseBytes = 330;    // a pose or a command with its force, with headers
constexpr std::size_t kRosterBytes = kHeaderBytes + 150, kClockBytes = kHeaderBytes + 80;

host_service::HostCoreSettings host_settings(const Subject& subject, const session::Material& material) {
  host_service::HostCoreSettings settings = host_service::host_of(subject.name, subject.encoded->compressed());
  settings.objects.front().config.material = material;
  return settings;
}

hrtc_service::HrtcCoreSettings core_settings(const SessionSettings& settings, double radius) {
  hrtc_service::HrtcCoreSettings core;
  core.pool = spm::PoolSettings::for_slots(settings.slots);
  core.servo.cycle = settings.cycle;
  core.servo.cycle.radius = radius;
  core.servo.specs.fill(settings.device_spec());
  return core;
}

std::size_t bytes_of(const session::Demand& demand) {
  return kHeaderBytes + 100 + 8 * (demand.have.size() + demand.wanted.size() + demand.gaps.size());
}

}  // namespace

VirtualSession::Hand::Hand(const client_sim::User& user, const SessionSettings& session, std::uint64_t seed)
    : script_operator{user, {}}, poses{session.link.a_to_b, 4 * seed}, commands{session.link.b_to_a, 4 * seed + 1} {
  settings.tremor = kTremor;
  settings.seed = static_cast<std::uint32_t>(seed);
  if (user.has_remote_device) remote = std::make_unique<haptics::RemoteDevice>(session.device_spec());
}

VirtualSession::VirtualSession(const Subject& subject, const client_sim::Scenario& scenario,
                               const SessionSettings& settings)
    : settings_{settings},
      host_{session::Origin{kSession, kHost, 1, 0}, host_settings(subject, settings.material), now_ns_},
      core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings(settings, scenario.users.front().radius)},
      membership_{session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session"}, core_.gateway(), now_ns_},
      records_{settings.link.a_to_b, 4 * settings.seed + 2},
      demands_{settings.link.b_to_a, 4 * settings.seed + 3},
      to_hrtc_{settings.link.a_to_b, 4 * (settings.seed * kSeedsPerRun) + 2},
      to_host_{settings.link.b_to_a, 4 * (settings.seed * kSeedsPerRun) + 3},
      catalogue_ns_{now_ns_ + static_cast<std::int64_t>(settings.link.a_to_b.delay_ms * 1e6)} {
  if (scenario.users.size() > hrtc_service::kMaxProbes) throw std::invalid_argument("more users than probes");
  for (const client_sim::User& user : scenario.users)
    hands_.push_back(std::make_unique<Hand>(user, settings, settings.seed * kSeedsPerRun + hands_.size()));
}

VirtualSession::~VirtualSession() = default;

bool VirtualSession::done() const {
  return std::all_of(hands_.begin(), hands_.end(), [](const auto& hand) { return hand->script_operator.done(); });
}

bool VirtualSession::base_shown() const {
  const std::vector<hrtc_service::TouchObject*>& objects = core_.servo().cycle().objects();
  return !objects.empty() && objects.front()->forest->is_base_shown();
}

void VirtualSession::settle() {
  constexpr int kMaxCycles = 60'000, kSettlingCycles = 1000;
  for (int i = 0, shown = 0; i < kMaxCycles; ++i) {
    step();
    if (base_shown() && ++shown == kSettlingCycles) {
      users_act_ = true;
      return;
    }
  }
  throw std::runtime_error("the base mesh was not shown for 1 s within a minute; does it fit the pool?");
}

/// Advances the time to `until_ns` and carries samples between HRTC and host over the link.
void VirtualSession::carry_samples(std::int64_t until_ns) {
  while (auto demand = core_.gateway().demand(now_ns_)) {
    const std::size_t bytes = bytes_of(*demand);
    demands_.send(now_ns_, std::move(*demand), bytes);
  }
  for (; now_ns_ < until_ns; now_ns_ += kNetworkStepNs) {
    while (const auto demand = demands_.take(now_ns_)) host_.on_demand(*demand, now_ns_);
    while (auto out = host_.next_chunk(now_ns_)) {
      const std::size_t bytes = kHeaderBytes + out->chunk.payload_bytes();
      records_.send(now_ns_, std::move(out->chunk), bytes);
    }
    while (const auto chunk = records_.take(now_ns_)) core_.gateway().on_chunk(*chunk, now_ns_);
    while (const auto arrive = to_hrtc_.take(now_ns_)) (*arrive)();
    while (const auto arrive = to_host_.take(now_ns_)) (*arrive)();
  }
}

/// Sends roster entries and clock requests over the link.
void VirtualSession::exchange_membership() {
  const host_service::HostMessages& messages = host_.tick(now_ns_);
  if (messages.roster)
    to_hrtc_.send(
        now_ns_, [this, entry = *messages.roster] { membership_.on_roster(entry, now_ns_); }, kRosterBytes);
  if (messages.clock_request) send_clock_to_hrtc(*messages.clock_request);
  if (const auto request = membership_.clock_request(now_ns_)) send_clock_to_host(request->sample);
  if (membership_.output.roster)
    to_host_.send(
        now_ns_, [this, entry = *membership_.output.roster] { host_.on_roster(entry, now_ns_); }, kRosterBytes);
  membership_.output.clear();
}

void VirtualSession::send_clock_to_host(const session::ClockSample& sample) {
  to_host_.send(
      now_ns_,
      [this, sample] {
        if (const auto answer = host_.on_clock(sample, now_ns_, now_ns_)) send_clock_to_hrtc(*answer);
      },
      kClockBytes);
}

void VirtualSession::send_clock_to_hrtc(const session::ClockSample& sample) {
  to_hrtc_.send(
      now_ns_,
      [this, sample] {
        membership_.on_clock(sample, now_ns_, now_ns_);
        for (const session::ClockSample& answer : std::exchange(membership_.output.clock, {}))
          send_clock_to_host(answer);
      },
      kClockBytes);
}

/// Lets the operator compute the user's next intent, and moves the user's device along it.
void VirtualSession::send_intent(Hand& hand) {
  if (!hand.has_script) return;
  if (const auto intent = hand.script_operator.tick(now_ns_, objects_)) move_device(hand, *intent);
}

void VirtualSession::move_device(Hand& hand, const session::Intent& intent) {
  if (!hand.device) {
    sharing::set_start(intent, hand.settings);
    hand.device.emplace(hand.settings, settings_.device_spec());
  }
  hand.device->paths().post(sharing::hand_path(intent, 0));
}

void VirtualSession::move_hand(std::size_t user, const session::Intent& intent) {
  hands_.at(user)->has_script = false;
  move_device(*hands_[user], intent);
}

void VirtualSession::set_link(const netem::LinkSettings& link) {
  settings_.link = link;
  records_.set_profile(link.a_to_b);
  to_hrtc_.set_profile(link.a_to_b);
  demands_.set_profile(link.b_to_a);
  to_host_.set_profile(link.b_to_a);
  for (const auto& hand : hands_) {
    hand->poses.set_profile(link.a_to_b);
    hand->commands.set_profile(link.b_to_a);
  }
}

/// Moves a remote hand as client_sim/remote_hand does, but with one clock for both ends.
void VirtualSession::move_remote(Hand& hand) {
  // Time since the last command, s: until the first the force is constant, and from the second on it is zero.
  constexpr double kMaxFreshAge = 0.010, kZeroForceAge = 0.060;
  while (const auto command = hand.commands.take(now_ns_)) {
    if (command->number <= hand.newest.number) continue;
    hand.newest = *command;
    hand.newest_ns = now_ns_;
    hand.script_operator.on_probe_state(command->state);
  }
  const double silent = static_cast<double>(now_ns_ - hand.newest_ns) * 1e-9;
  const double share = std::clamp((kZeroForceAge - silent) / (kZeroForceAge - kMaxFreshAge), 0.0, 1.0);
  hand.felt.wrench = {share * hand.newest.wrench.force, share * hand.newest.wrench.torque};
  hand.felt.exact = (hand.newest.state.status & session::kExact) != 0;
  hand.device->write_wrench(hand.felt.wrench.force, hand.felt.wrench.torque);
  const haptics::DeviceState state = hand.device->read(now_ns_);
  hand.felt.device = state;
  haptics::RemotePose pose;
  pose.position = hrtc_service::plain(state.position);
  pose.velocity = hrtc_service::plain(state.velocity);
  pose.orientation = hrtc_service::plain(state.orientation);
  pose.buttons = state.buttons;
  pose.sequence = ++hand.last_pose_number;
  pose.command_applied = hand.newest.number;
  pose.measured_ns = now_ns_;
  hand.poses.send(now_ns_, pose, kPoseBytes);
}

void VirtualSession::read_device(std::size_t user) {
  Hand& hand = *hands_[user];
  hrtc_service::ProbeInput& input = inputs_[user];
  if (!hand.device) return;
  if (hand.remote) {
    move_remote(hand);
    while (auto pose = hand.poses.take(now_ns_)) {
      pose->arrived_ns = now_ns_;
      if (session::accepted(hand.pose_window.admit(pose->sequence, now_ns_))) hand.remote->on_pose(*pose);
    }
    if (!hand.remote->has_pose()) return;
    input.device = hand.remote->read(now_ns_);
  } else {
    input.device = hand.device->read(now_ns_);
    hand.felt.device = input.device;
  }
  input.active = true;
  input.pose_age = static_cast<double>(now_ns_ - input.device.time_ns) * 1e-9;
}

void VirtualSession::deliver_output(std::size_t user, const hrtc_service::ProbeOutput& output) {
  Hand& hand = *hands_[user];
  if (!output.active) return;
  session::ProbeState state;
  state.user_id = session::id_of(hand.script_operator.user().name);
  state.session_time_ns = now_ns_;
  state.device.position = output.device;
  state.proxy = output.proxy;
  state.velocity = output.velocity;
  state.force = output.force;
  state.status = output.status;
  const haptics::Wrench wrench{hrtc_service::vec(output.force), hrtc_service::vec(output.torque)};
  if (hand.remote) {
    hand.commands.send(now_ns_, {state, wrench, hand.remote->on_command(now_ns_)}, kPoseBytes);
    return;
  }
  hand.felt.wrench = wrench;
  hand.felt.exact = (output.status & session::kExact) != 0;
  hand.device->write_wrench(wrench.force, wrench.torque);
  hand.script_operator.on_probe_state(state);
}

void VirtualSession::step() {
  ++cycles_;
  exchange_membership();
  carry_samples(now_ns_ + kCycleNs);
  if (objects_.empty() && now_ns_ >= catalogue_ns_) {
    const session::CatalogueEntry& entry = host_.catalogue().front();
    membership_.on_catalogue(entry);
    objects_[entry.object] = client_sim::view_of(entry);
  }
  if (cycles_ % 2 == 0) {
    core_.gateway().tick(now_ns_, membership_.clock());
    membership_.tick(now_ns_);
  }
  if (users_act_) {
    for (std::size_t user = 0; user < hands_.size(); ++user) {
      send_intent(*hands_[user]);
      read_device(user);
    }
  }
  core_.tick_intake();
  hrtc_service::Servo& servo = core_.servo();
  const hrtc_service::Servo::Outputs& outputs = servo.touch(inputs_, now_ns_);
  for (std::size_t user = 0; user < hands_.size(); ++user) deliver_output(user, outputs[user]);
  servo.publish(now_ns_, now_ns_ + kCycleNs);
  mesh_changed_ = changed_;
  changed_ = servo.refine(spm::Budget{settings_.budget}).costs.changes > 0;
}

}  // namespace tactus::study
