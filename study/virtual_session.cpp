#include "study/virtual_session.hpp"

#include <algorithm>
#include <stdexcept>

#include "sharing/hand_path.hpp"

namespace tactus::study {
namespace {

using spm::Vec3d;

constexpr std::uint64_t kHost = 10, kHrtc = 20, kSession = 30;
constexpr std::int64_t kCycleNs = 1'000'000, kNetworkStepNs = 250'000;
constexpr double kDt = 1e-3;
constexpr double kTremor = 1e-4;         // m rms, of a resting hand between 8 and 12 Hz
constexpr std::size_t kHeads = 170;      // bytes around a payload: Ethernet, IP, UDP, RTPS, ours
constexpr std::size_t kPoseBytes = 330;  // a pose or a command with its force, heads and all

session::CatalogueEntry entry_for(const Subject& subject, const session::Material& material, std::uint32_t base_bytes) {
  session::CatalogueEntry entry;
  entry.origin = {kSession, kHost, 1, 0};
  entry.host = "host";
  entry.object = subject.name;
  entry.object_id = session::id_of(subject.name);
  entry.summary = subject.model.summary;
  entry.scale = subject.model.summary.metres_per_unit;
  entry.material = material;
  entry.base_bytes = base_bytes;
  return entry;
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
  return kHeads + 100 + 8 * (demand.have.size() + demand.wanted.size() + demand.gaps.size());
}

}  // namespace

VirtualSession::Hand::Hand(const client_sim::User& user, const SessionSettings& session, std::uint64_t seed)
    : mind{user, {}}, poses{session.link.forth, 4 * seed}, commands{session.link.back, 4 * seed + 1} {
  settings.tremor = kTremor;
  settings.seed = static_cast<std::uint32_t>(seed);
  if (user.remote) remote = std::make_unique<haptics::RemoteDevice>(session.device_spec());
}

VirtualSession::VirtualSession(const Subject& subject, const client_sim::Scenario& scenario,
                               const SessionSettings& settings)
    : settings_{settings},
      server_{session::Origin{kSession, kHost, 1, 0}},
      core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings(settings, scenario.users.front().radius)},
      records_{settings.link.forth, 4 * settings.seed + 2},
      demands_{settings.link.back, 4 * settings.seed + 3},
      catalogue_ns_{now_ns_ + static_cast<std::int64_t>(settings.link.forth.delay_ms * 1e6)} {
  if (scenario.users.size() > hrtc_service::kMaxProbes) throw std::invalid_argument("more users than probes");
  server_.add(session::id_of(subject.name), subject.encoded->coded());
  entry_ = entry_for(subject, settings.material, server_.base_bytes(session::id_of(subject.name)));
  for (const client_sim::User& user : scenario.users)
    hands_.push_back(std::make_unique<Hand>(user, settings, settings.seed * 64 + hands_.size()));
}

VirtualSession::~VirtualSession() = default;

bool VirtualSession::done() const {
  return std::all_of(hands_.begin(), hands_.end(), [](const auto& hand) { return hand->mind.done(); });
}

bool VirtualSession::base_shown() const {
  const std::vector<hrtc_service::TouchObject*>& objects = core_.servo().cycle().objects();
  return !objects.empty() && objects.front()->forest->base_shown();
}

void VirtualSession::settle() {
  constexpr int kPatience = 60'000, kCalm = 1000;  // cycles
  for (int i = 0, shown = 0; i < kPatience; ++i) {
    step();
    if (base_shown() && ++shown == kCalm) {
      acting_ = true;
      return;
    }
  }
  throw std::runtime_error("the base mesh did not come within a minute: does it fit the pool?");
}

/// Loader and host meet on the link.
void VirtualSession::move_network(std::int64_t until_ns) {
  while (auto demand = core_.gateway().demand(now_ns_)) {
    const std::size_t bytes = bytes_of(*demand);
    demands_.send(now_ns_, std::move(*demand), bytes);
  }
  for (; now_ns_ < until_ns; now_ns_ += kNetworkStepNs) {
    while (const auto demand = demands_.take(now_ns_)) (void)server_.on_demand(*demand, now_ns_);
    while (auto out = server_.next(now_ns_)) {
      const std::size_t bytes = kHeads + out->chunk.payload_bytes();
      records_.send(now_ns_, std::move(out->chunk), bytes);
    }
    while (const auto chunk = records_.take(now_ns_)) core_.gateway().on_chunk(*chunk, now_ns_);
  }
}

/// The user's next wish, from what it has felt.
void VirtualSession::think(Hand& hand) {
  const std::optional<session::Intent> intent = hand.mind.tick(now_ns_, objects_);
  if (!intent) return;
  if (!hand.device) {
    sharing::begin_at(*intent, hand.settings);
    hand.device.emplace(hand.settings, settings_.device_spec());
  }
  hand.device->wishes().post(sharing::hand_path(*intent, 0));
}

/// What client_sim/remote_hand does, with a clock that is known to both ends.
void VirtualSession::move_remote(Hand& hand) {
  constexpr double kHold = 0.010, kZeroBy = 0.060;  // s
  while (const auto command = hand.commands.take(now_ns_)) {
    if (command->number <= hand.newest.number) continue;
    hand.newest = *command;
    hand.newest_ns = now_ns_;
    hand.mind.on_probe_state(command->state);
  }
  const double silent = static_cast<double>(now_ns_ - hand.newest_ns) * 1e-9;
  const double share = std::clamp((kZeroBy - silent) / (kZeroBy - kHold), 0.0, 1.0);
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
  pose.sequence = ++hand.numbered;
  pose.command_felt = hand.newest.number;
  pose.taken_ns = now_ns_;
  hand.poses.send(now_ns_, pose, kPoseBytes);
}

void VirtualSession::read(std::size_t user) {
  Hand& hand = *hands_[user];
  hrtc_service::ProbeInput& input = inputs_[user];
  if (!hand.device) return;
  if (hand.remote) {
    move_remote(hand);
    while (auto pose = hand.poses.take(now_ns_)) {
      pose->arrived_ns = now_ns_;
      if (session::accepted(hand.numbers.admit(pose->sequence, now_ns_))) hand.remote->on_pose(*pose);
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

void VirtualSession::report(std::size_t user, const hrtc_service::ProbeOutput& output) {
  Hand& hand = *hands_[user];
  if (!output.active) return;
  session::ProbeState state;
  state.user_id = session::id_of(hand.mind.user().name);
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
  hand.mind.on_probe_state(state);
}

void VirtualSession::step() {
  ++cycles_;
  move_network(now_ns_ + kCycleNs);
  if (cycles_ % 50 == 0) core_.gateway().on_host_seen(kHost, 1, now_ns_);
  if (objects_.empty() && now_ns_ >= catalogue_ns_) {
    core_.gateway().on_host_seen(kHost, 1, now_ns_);
    core_.gateway().on_catalogue(entry_);
    objects_[entry_.object] = client_sim::view_of(entry_);
  }
  if (cycles_ % 2 == 0) core_.gateway().tick(now_ns_, session::ClockMap{});
  if (acting_) {
    for (std::size_t user = 0; user < hands_.size(); ++user) {
      think(*hands_[user]);
      read(user);
    }
  }
  hrtc_service::Servo& servo = core_.servo();
  const hrtc_service::Servo::Outputs& outputs = servo.touch(inputs_, now_ns_);
  for (std::size_t user = 0; user < hands_.size(); ++user) report(user, outputs[user]);
  servo.publish(now_ns_, now_ns_ + kCycleNs);
  looked_anew_ = changed_;
  changed_ = servo.refine(spm::Budget{settings_.budget}).costs.changes > 0;
}

}  // namespace tactus::study
