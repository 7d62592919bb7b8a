#include "study/shared_session.hpp"

#include <algorithm>
#include <utility>

#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "session/figures.hpp"
#include "sharing/hand_path.hpp"
#include "study/constants.hpp"

namespace tactus::study {
namespace {

using spm::Vec3d;

constexpr std::uint64_t kHost = 100;
constexpr std::size_t kHostNode = 0, kViewerNode = 1, kFirstHrtcNode = 2;
constexpr std::size_t kHeaderBytes = 170;  // of Ethernet, IP, UDP, RTPS and Tactus
constexpr std::size_t kSmallBytes = 250;   // a claim, grant, pose or roster entry with headers
constexpr std::size_t kClockBytes = 250;
constexpr std::size_t kCopyBytes = 400, kStateBytes = 330;

session::Origin origin_of(std::uint64_t participant, std::uint64_t incarnation) {
  return {kSession, participant, incarnation, 0};
}

host_service::HostCoreSettings host_settings(const Subject& subject, double mass) {
  const spm::ModelSummary& summary = subject.model.summary;
  host_service::HostCoreSettings settings = host_service::host_of(subject.name, subject.encoded->compressed());
  host_service::ObjectConfig& object = settings.objects.front().config;
  object.pose->position[2] = -summary.metres_per_unit * double{summary.bounds_min[2]};
  object.material = {1000, 3, 0.9, 0.8};
  object.body = {mass, {}, 0.6, 0};
  return settings;
}

hrtc_service::HrtcCoreSettings core_settings() {
  hrtc_service::HrtcCoreSettings settings;
  settings.pool = spm::PoolSettings::for_slots(1 << 13);
  settings.servo.cycle.force.soft_start = 0.01;
  return settings;
}

}  // namespace

struct SharedSession::Hrtc {
  /// `clock`: current virtual time, which the host's clock shows. `offset_ns`: the clock of the HRTC's machine minus
  /// `clock`.
  Hrtc(const session::Origin& self, const std::int64_t& clock, std::int64_t offset_ns)
      : clock_ns{clock},
        clock_offset_ns{offset_ns},
        origin{self},
        core{self, core_settings()},
        membership{self, {"hrtc " + std::to_string(self.participant), "session"}, core.gateway(), now_ns()} {}
  /// Time of the HRTC's machine.
  [[nodiscard]] std::int64_t now_ns() const { return clock_ns + clock_offset_ns; }
  [[nodiscard]] std::int64_t session_ns() const { return membership.clock().session_time(now_ns()); }

  const std::int64_t& clock_ns;
  std::int64_t clock_offset_ns;
  session::Origin origin;
  hrtc_service::HrtcCore core;
  hrtc_service::Membership membership;
  hrtc_service::Servo::Inputs inputs{};
  hrtc_service::MailboxReader<hrtc_service::BodyReports> reports_in{core.link().bodies.reports};
  hrtc_service::RingWriter<hrtc_service::CopyArrival, hrtc_service::BodyLink::kCopies> copies_out{
      core.link().bodies.copies};
  hrtc_service::BodyReports reports;
  std::uint32_t probes = 0, index = 0;
  std::uint32_t pose_sequence = 0;
  std::int64_t posed_ns = 0;
  bool is_dead = false;
};

SharedSession::SharedSession(const Subject& subject, const SharedSessionSettings& settings)
    : subject_{subject}, settings_{settings} {
  for (const std::size_t node : {kHostNode, kViewerNode}) add_links(node);
  start_host();
  while (!settings_.host_begins_late && !host_->clock().answers_requests()) (void)host_->tick(now_ns_ += 2 * kMs);
  shared_ = sharing::body_of(entry_);
  view_[entry_.object] = client_sim::view_of(entry_);
}
SharedSession::~SharedSession() = default;

/// Creates the links between a new node and all existing nodes.
void SharedSession::add_links(std::size_t node) {
  const auto make_link = [&](std::size_t from, std::size_t to) {
    constexpr std::uint64_t kMaxNodes = 64;
    const auto& profile = from < to ? settings_.link.a_to_b : settings_.link.b_to_a;
    return VirtualLink<Arrive>{profile, (settings_.seed * kMaxNodes + from) * kMaxNodes + to};
  };
  for (std::size_t from = 0; from < node; ++from) links_[from].push_back(make_link(from, node));
  links_.emplace_back();
  for (std::size_t to = 0; to <= node; ++to) links_[node].push_back(make_link(node, to));
}

void SharedSession::start_host() {
  // An incarnation is a time in ns. A host's fencing numbers count up from it and stay below the next incarnation.
  const session::Origin self = origin_of(kHost, static_cast<std::uint64_t>(now_ns_));
  host_ = std::make_unique<host_service::HostCore>(self, host_settings(subject_, settings_.mass), now_ns_);
  entry_ = host_->catalogue().front();
  ++host_changes_;
}

void SharedSession::stop_host() {
  host_.reset();
  ++host_changes_;
}

std::size_t SharedSession::add_hrtc(std::int64_t clock_offset_ns) {
  const std::size_t i = hrtcs_.size();
  hrtcs_.push_back(std::make_unique<Hrtc>(origin_of(i + 1, 1), now_ns_, clock_offset_ns));
  add_links(kFirstHrtcNode + i);
  Hrtc& hrtc = *hrtcs_.back();
  hrtc_service::Gateway& gateway = hrtc.core.gateway();
  gateway.on_object = [&hrtc](const hrtc_service::ObjectDescription& object) { hrtc.index = object.index; };
  if (host_ != nullptr) send_catalogue(i);
  return i;
}

void SharedSession::send_catalogue(std::size_t hrtc) {
  for (const session::CatalogueEntry& entry : host_->catalogue())
    to_hrtc(kHostNode, hrtc, kSmallBytes, [entry](Hrtc& receiver) { receiver.membership.on_catalogue(entry); });
}

void SharedSession::kill_hrtc(std::size_t hrtc) { hrtcs_[hrtc]->is_dead = true; }

std::size_t SharedSession::append_user(std::size_t hrtc, User user) {
  user.hrtc = hrtc;
  user.probe = hrtcs_[hrtc]->probes++;
  user.hand.seed = static_cast<std::uint32_t>(settings_.seed * 64 + users_.size() + 1);
  user.hand.tremor = settings_.tremor;
  users_.push_back(std::move(user));
  return users_.size() - 1;
}

std::size_t SharedSession::add_user(std::size_t hrtc, const client_sim::User& person) {
  User user;
  user.id = session::id_of(person.name);
  user.script_operator = std::make_unique<client_sim::Operator>(person, client_sim::OperatorSettings{});
  return append_user(hrtc, std::move(user));
}

std::size_t SharedSession::add_hand(std::size_t hrtc, const Vec3d& start) {
  const std::size_t i = append_user(hrtc, {});
  users_[i].id = session::id_of("hand" + std::to_string(i));
  users_[i].hand.start = start;
  users_[i].device = std::make_unique<haptics::SimulatedDevice>(users_[i].hand);
  return i;
}

void SharedSession::move_hand(std::size_t user, const Vec3d& to) {
  haptics::HandPath path;
  path.count = 1;
  path.waypoints[0] = {now_ns_, {to.x(), to.y(), to.z()}};
  users_[user].device->paths().post(path);
}

const hrtc_service::BodyReport* SharedSession::body(std::size_t hrtc) const {
  const hrtc_service::BodyReports& reports = hrtcs_[hrtc]->reports;
  return reports.count == 0 ? nullptr : &reports.bodies[0];
}

session::Claimant::Role SharedSession::role(std::size_t hrtc) const {
  return hrtcs_[hrtc]->core.gateway().ownership().role(hrtcs_[hrtc]->index, hrtcs_[hrtc]->now_ns());
}

double SharedSession::figure(std::size_t hrtc, const std::string& name) const {
  std::vector<session::Figure> figures;
  hrtcs_[hrtc]->core.gateway().ownership().add_figures(figures);
  for (const session::Figure& figure : figures)
    if (figure.name == name) return figure.value;
  return 0;
}

const haptics::PassivityController::Ledger& SharedSession::port(std::size_t user) const {
  return hrtcs_[users_[user].hrtc]->reports.ports[users_[user].probe];
}

const hrtc_service::ProbeOutput& SharedSession::probe(std::size_t user) const {
  return hrtcs_[users_[user].hrtc]->core.servo().outputs()[users_[user].probe];
}

bool SharedSession::done() const {
  return std::all_of(users_.begin(), users_.end(),
                     [](const User& user) { return user.script_operator == nullptr || user.script_operator->done(); });
}

void SharedSession::send(std::size_t from, std::size_t to, std::size_t bytes, Arrive arrive) {
  links_[from][to].send(now_ns_, std::move(arrive), bytes);
}

void SharedSession::to_host(std::size_t from, std::size_t bytes, Arrive arrive) {
  send(from, kHostNode, bytes, [this, changes = host_changes_, arrive = std::move(arrive)] {
    if (host_ != nullptr && changes == host_changes_) arrive();
  });
}

void SharedSession::to_hrtc(std::size_t from, std::size_t i, std::size_t bytes, std::function<void(Hrtc&)> arrive) {
  send(from, kFirstHrtcNode + i, bytes, [this, i, arrive = std::move(arrive)] {
    if (!hrtcs_[i]->is_dead) arrive(*hrtcs_[i]);
  });
}

/// Sends to all other nodes.
void SharedSession::publish(std::size_t from, const session::ObjectPose& pose) {
  if (from != kHostNode) to_host(from, kSmallBytes, [this, pose] { host_->on_pose(pose, now_ns_); });
  for (std::size_t i = 0; i < hrtcs_.size(); ++i) {
    if (from == kFirstHrtcNode + i) continue;
    to_hrtc(from, i, kSmallBytes,
            [pose](Hrtc& hrtc) { hrtc.core.gateway().on_pose(pose, hrtc.now_ns(), hrtc.session_ns()); });
  }
  send(from, kViewerNode, kSmallBytes, [this, pose] { on_viewer_pose(pose); });
}

void SharedSession::on_viewer_pose(const session::ObjectPose& pose) {
  if (!pose_admission_.accept(pose, now_ns_)) return;
  viewer_pose_ = pose;
  session::CatalogueEntry moved = entry_;
  moved.pose = pose.pose;
  view_[entry_.object] = client_sim::view_of(moved);
}

void SharedSession::haptic_cycle(std::size_t i) {
  Hrtc& hrtc = *hrtcs_[i];
  hrtc.core.tick_intake();
  hrtc_service::Servo& servo = hrtc.core.servo();
  for (User& user : users_) {
    if (user.hrtc != i || user.device == nullptr) continue;
    hrtc_service::ProbeInput& input = hrtc.inputs[user.probe];
    input.active = true;
    input.device = user.device->read(now_ns_);
  }
  if (settings_.observer != nullptr) settings_.observer->on_begin();
  const hrtc_service::Servo::Outputs& outputs = servo.touch(hrtc.inputs, hrtc.now_ns());
  for (User& user : users_)
    if (user.hrtc == i && user.device != nullptr) user.device->write(hrtc_service::vec(outputs[user.probe].force));
  servo.publish(hrtc.now_ns(), hrtc.now_ns() + kMs);
  (void)servo.refine(spm::Budget{1u << 20});
  if (settings_.observer != nullptr) settings_.observer->on_end();
  (void)hrtc.reports_in.take(hrtc.reports);
}

void SharedSession::send_reports(std::size_t i) {
  Hrtc& hrtc = *hrtcs_[i];
  const hrtc_service::BodyReport& body = hrtc.reports.bodies[0];
  if (hrtc.reports.count == 0) return;
  for (std::size_t to = 0; body.copies > 0 && to < hrtcs_.size(); ++to) {
    if (to == i) continue;
    session::ObjectCopy copy;
    sharing::put_sample(body.sample, body.copies, copy);
    to_hrtc(kFirstHrtcNode + i, to, kCopyBytes,
            [copy_index = body.copy_index, fencing = body.coupling_fencing, copy](Hrtc& peer) {
              const std::int64_t session_ns = peer.session_ns();
              peer.core.gateway().on_transit(session_ns - copy.session_time_ns, session_ns);
              (void)peer.copies_out.push({peer.index, copy_index, fencing, sharing::sample_of(copy)});
              peer.core.gateway().on_peer_received(peer.index, peer.now_ns());
            });
  }
  if (body.publish_fencing == 0 || now_ns_ - hrtc.posed_ns < hrtc_service::kPosePeriodNs) return;
  hrtc.posed_ns = now_ns_;
  session::ObjectPose pose;
  pose.origin = hrtc.origin;
  pose.object_id = entry_.object_id;
  pose.sequence = ++hrtc.pose_sequence;
  pose.fencing = body.publish_fencing;
  pose.session_time_ns = hrtc.reports.session_ns;
  sharing::put_state(body.state, shared_.centre, pose);
  publish(kFirstHrtcNode + i, pose);
}

void SharedSession::step_gateway(std::size_t i) {
  Hrtc& hrtc = *hrtcs_[i];
  hrtc_service::Gateway& gateway = hrtc.core.gateway();
  gateway.tick(hrtc.now_ns(), hrtc.membership.clock());
  hrtc.membership.tick(hrtc.now_ns());
  if (auto request = hrtc.membership.clock_request(hrtc.now_ns())) send_clock(kFirstHrtcNode + i, request->sample);
  send_membership(i);
  while (auto demand = gateway.demand(hrtc.now_ns())) {
    const std::size_t bytes =
        kHeaderBytes + 100 + 8 * (demand->have.size() + demand->wanted.size() + demand->gaps.size());
    to_host(kFirstHrtcNode + i, bytes, [this, demand = *demand] { host_->on_demand(demand, now_ns_); });
  }
  for (const session::ObjectClaim& claim : gateway.claims())
    to_host(kFirstHrtcNode + i, kSmallBytes, [this, claim] { host_->on_claim(claim, now_ns_); });
}

/// Sends the roster entry and the clock answers of an HRTC.
void SharedSession::send_membership(std::size_t i) {
  const hrtc_service::MembershipOutput output = std::exchange(hrtcs_[i]->membership.output, {});
  for (const session::ClockSample& answer : output.clock) send_clock(kFirstHrtcNode + i, answer);
  if (!output.roster) return;
  const session::RosterEntry& entry = *output.roster;
  to_host(kFirstHrtcNode + i, kSmallBytes, [this, entry] { host_->on_roster(entry, now_ns_); });
  send_to_hrtcs(kFirstHrtcNode + i, kSmallBytes,
                [entry](Hrtc& hrtc) { hrtc.membership.on_roster(entry, hrtc.now_ns()); });
}

/// Sends a clock request or an answer to `sample.peer`.
void SharedSession::send_clock(std::size_t from, const session::ClockSample& sample) {
  if (sample.peer == kHost) {
    to_host(from, kClockBytes, [this, sample] {
      if (const auto answer = host_->on_clock(sample, now_ns_, now_ns_)) send_clock(kHostNode, *answer);
    });
    return;
  }
  if (sample.peer < 1 || sample.peer > hrtcs_.size()) return;
  const auto to = static_cast<std::size_t>(sample.peer) - 1;
  to_hrtc(from, to, kClockBytes, [this, to, sample](Hrtc& hrtc) {
    hrtc.membership.on_clock(sample, hrtc.now_ns(), hrtc.now_ns());
    send_membership(to);
  });
}

/// Sends to all HRTCs except the sender.
void SharedSession::send_to_hrtcs(std::size_t from, std::size_t bytes, const std::function<void(Hrtc&)>& arrive) {
  for (std::size_t i = 0; i < hrtcs_.size(); ++i)
    if (from != kFirstHrtcNode + i) to_hrtc(from, i, bytes, arrive);
}

/// Delivers the state of the user's probe to the user and to the other HRTCs, then applies the user's next intent.
void SharedSession::step_user(User& user) {
  if (hrtcs_[user.hrtc]->is_dead) return;
  if (user.device != nullptr) {
    const hrtc_service::ProbeOutput& output = hrtcs_[user.hrtc]->core.servo().outputs()[user.probe];
    const Hrtc& own = *hrtcs_[user.hrtc];
    session::ProbeState state;
    state.origin = own.origin;
    state.user_id = user.id;
    state.probe = user.probe;
    state.sequence = ++user.sequence;
    state.session_time_ns = own.session_ns();
    const std::int64_t bound_us = own.membership.clock().error_bound(own.now_ns()) / 1000;
    state.time_bound_us = static_cast<std::uint32_t>(std::min<std::int64_t>(bound_us, 0xffffffff));
    state.device.position = output.device;
    state.proxy = output.proxy;
    state.force = output.force;
    state.status = output.status;
    state.object_id = output.object != spm::kNone ? entry_.object_id : 0;
    if (user.script_operator != nullptr) user.script_operator->on_probe_state(state);
    for (std::size_t i = 0; i < hrtcs_.size(); ++i) {
      const auto receive = [this, state, i, local = i == user.hrtc](Hrtc& hrtc) {
        if (!local) hrtc.membership.on_state(state, session::StateStream::kDeadbandCoded, hrtc.now_ns());
        for (User& other : users_)
          if (other.hrtc == i && other.script_operator != nullptr) other.script_operator->on_other_probe_state(state);
      };
      if (i == user.hrtc)
        receive(*hrtcs_[i]);
      else
        to_hrtc(kFirstHrtcNode + user.hrtc, i, kStateBytes, receive);
    }
  }
  if (user.script_operator == nullptr) return;
  const std::optional<session::Intent> intent = user.script_operator->tick(now_ns_, view_);
  if (!intent) return;
  if (user.device == nullptr) {
    sharing::set_start(*intent, user.hand);
    user.device = std::make_unique<haptics::SimulatedDevice>(user.hand);
  }
  user.device->paths().post(sharing::hand_path(*intent, 0));
}

void SharedSession::host_tick() {
  const host_service::HostMessages& messages = host_->tick(now_ns_);
  if (messages.catalogue)
    for (std::size_t i = 0; i < hrtcs_.size(); ++i) send_catalogue(i);
  if (messages.roster)
    send_to_hrtcs(kHostNode, kSmallBytes,
                  [entry = *messages.roster](Hrtc& hrtc) { hrtc.membership.on_roster(entry, hrtc.now_ns()); });
  if (messages.clock_request) send_clock(kHostNode, *messages.clock_request);
  for (const session::ObjectGrant& grant : messages.grants)
    send_to_hrtcs(kHostNode, kSmallBytes, [grant](Hrtc& hrtc) { hrtc.core.gateway().on_grant(grant, hrtc.now_ns()); });
  for (const session::ObjectPose& pose : messages.poses) publish(kHostNode, pose);
  while (auto out = host_->next_chunk(now_ns_)) {
    const std::uint64_t receiver = out->hrtc;
    if (receiver < 1 || receiver > hrtcs_.size()) continue;
    const std::size_t bytes = kHeaderBytes + out->chunk.payload_bytes();
    to_hrtc(kHostNode, receiver - 1, bytes,
            [chunk = std::move(out->chunk)](Hrtc& hrtc) { hrtc.core.gateway().on_chunk(chunk, hrtc.now_ns()); });
  }
}

void SharedSession::step() {
  now_ns_ += kMs;
  for (auto& from : links_)
    for (VirtualLink<Arrive>& path : from)
      while (const auto arrive = path.take(now_ns_)) (*arrive)();
  const bool even = now_ns_ / kMs % 2 == 0;
  for (std::size_t i = 0; i < hrtcs_.size(); ++i) {
    if (hrtcs_[i]->is_dead) continue;
    haptic_cycle(i);
    send_reports(i);
    if (even) step_gateway(i);
  }
  if (even)
    for (User& user : users_) step_user(user);
  if (host_ != nullptr) host_tick();
}

}  // namespace tactus::study
