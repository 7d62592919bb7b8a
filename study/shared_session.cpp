#include "study/shared_session.hpp"

#include <algorithm>

#include "hrtc_service/hrtc_core.hpp"
#include "session/figures.hpp"
#include "sharing/hand_path.hpp"

namespace tactus::study {
namespace {

using hrtc_service::kMaxProbes;
using spm::Vec3d;

constexpr std::uint64_t kSession = 30, kHost = 100, kTimeKeeper = 200;
constexpr std::size_t kHostNode = 0, kViewerNode = 1, kFirstHrtcNode = 2;
constexpr std::size_t kHeads = 170;       // bytes of headers: Ethernet, IP, UDP, RTPS, ours
constexpr std::size_t kSmallBytes = 250;  // a claim, grant or pose with headers
constexpr std::size_t kCopyBytes = 400, kStateBytes = 330;

session::Origin origin_of(std::uint64_t participant, std::uint64_t incarnation) {
  return {kSession, participant, incarnation, 0};
}

host_service::HostCoreSettings host_settings(const Subject& subject, double mass) {
  const spm::ModelSummary& summary = subject.model.summary;
  host_service::HostCoreSettings settings = host_service::host_of(subject.name, subject.encoded->coded());
  host_service::ObjectConfig& object = settings.objects.front().config;
  object.pose->position[2] = -summary.metres_per_unit * double{summary.bounds_min[2]};
  object.material = {1000, 3, 0.9, 0.8};
  object.body = {mass, {}, 0.6, 0};
  return settings;
}

/// Of an HRTC whose clock is session time.
session::RosterEntry time_keeper(std::int64_t now_ns) {
  session::RosterEntry entry;
  entry.origin = origin_of(kTimeKeeper, 1);
  entry.role = session::Role::kHrtc;
  entry.name = "time";
  entry.heartbeat = 1;
  entry.reference = kTimeKeeper;
  entry.session_time_ns = now_ns;
  entry.joined_ns = 0;
  return entry;
}

hrtc_service::HrtcCoreSettings core_settings() {
  hrtc_service::HrtcCoreSettings settings;
  settings.pool = spm::PoolSettings::for_slots(1 << 13);
  settings.servo.cycle.force.soft_start = 0.01;
  return settings;
}

}  // namespace

struct SharedSession::Hrtc {
  explicit Hrtc(const session::Origin& self) : origin{self}, core{self, core_settings()} {}

  session::Origin origin;
  hrtc_service::HrtcCore core;
  hrtc_service::Servo::Inputs inputs{};
  hrtc_service::BodyReports reports;
  std::uint32_t probes = 0, index = 0;
  std::uint32_t pose_sequence = 0;
  std::int64_t posed_ns = 0;
  bool dead = false;
};

SharedSession::SharedSession(const Subject& subject, const SharedSessionSettings& settings)
    : subject_{subject}, settings_{settings} {
  for (const std::size_t node : {kHostNode, kViewerNode}) connect(node);
  start_host();
  shared_ = sharing::body_of(entry_);
  view_[entry_.object] = client_sim::view_of(entry_);
}
SharedSession::~SharedSession() = default;

/// Creates the links between a new node and all existing ones.
void SharedSession::connect(std::size_t node) {
  const auto make_path = [&](std::size_t from, std::size_t to) {
    constexpr std::uint64_t kMaxNodes = 64;
    const auto& profile = from < to ? settings_.link.forth : settings_.link.back;
    return Path<Arrive>{profile, (settings_.seed * kMaxNodes + from) * kMaxNodes + to};
  };
  for (std::size_t from = 0; from < node; ++from) paths_[from].push_back(make_path(from, node));
  paths_.emplace_back();
  for (std::size_t to = 0; to <= node; ++to) paths_[node].push_back(make_path(node, to));
}

void SharedSession::start_host() {
  // Incarnations are nanoseconds, of which one life uses few as fencing numbers.
  const session::Origin self = origin_of(kHost, static_cast<std::uint64_t>(now_ns_));
  host_ = std::make_unique<host_service::HostCore>(self, host_settings(subject_, settings_.mass), now_ns_);
  host_->on_roster(time_keeper(now_ns_), now_ns_);
  entry_ = host_->catalogue().front();
  ++host_life_;
}

/// Clocks of this session do not differ. The host continues this time when its reference sends nothing more.
void SharedSession::set_host_clock(const session::ClockSample& request) {
  session::ClockSample answer = request;
  answer.origin = time_keeper(now_ns_).origin;
  answer.peer = kHost;
  answer.answer = true;
  answer.t1_ns = answer.t2_ns = now_ns_;
  (void)host_->on_clock(answer, now_ns_, now_ns_);
}

void SharedSession::stop_host() {
  host_.reset();
  ++host_life_;
}

std::size_t SharedSession::add_hrtc() {
  const std::size_t i = hrtcs_.size();
  hrtcs_.push_back(std::make_unique<Hrtc>(origin_of(i + 1, 1)));
  connect(kFirstHrtcNode + i);
  Hrtc& hrtc = *hrtcs_.back();
  hrtc_service::Gateway& gateway = hrtc.core.gateway();
  gateway.on_object = [&hrtc](const hrtc_service::TouchObject& object) { hrtc.index = object.index; };
  gateway.on_host_seen(kHost, entry_.origin.incarnation, now_ns_);
  gateway.on_catalogue(entry_);
  return i;
}

void SharedSession::kill_hrtc(std::size_t hrtc) { hrtcs_[hrtc]->dead = true; }

std::size_t SharedSession::join(std::size_t hrtc, User user) {
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
  user.op = std::make_unique<client_sim::Operator>(person, client_sim::OperatorSettings{});
  return join(hrtc, std::move(user));
}

std::size_t SharedSession::add_hand(std::size_t hrtc, const Vec3d& start) {
  const std::size_t i = join(hrtc, {});
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

session::Holder::Role SharedSession::role(std::size_t hrtc) const {
  return hrtcs_[hrtc]->core.gateway().ownership().role(hrtcs_[hrtc]->index, now_ns_);
}

double SharedSession::figure(std::size_t hrtc, const std::string& name) const {
  std::vector<session::Figure> figures;
  hrtcs_[hrtc]->core.gateway().ownership().write(figures);
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
                     [](const User& user) { return user.op == nullptr || user.op->done(); });
}

void SharedSession::send(std::size_t from, std::size_t to, std::size_t bytes, Arrive arrive) {
  paths_[from][to].send(now_ns_, std::move(arrive), bytes);
}

void SharedSession::to_host(std::size_t from, std::size_t bytes, Arrive arrive) {
  send(from, kHostNode, bytes, [this, life = host_life_, arrive = std::move(arrive)] {
    if (host_ != nullptr && life == host_life_) arrive();
  });
}

void SharedSession::to_hrtc(std::size_t from, std::size_t i, std::size_t bytes, std::function<void(Hrtc&)> arrive) {
  send(from, kFirstHrtcNode + i, bytes, [this, i, arrive = std::move(arrive)] {
    if (!hrtcs_[i]->dead) arrive(*hrtcs_[i]);
  });
}

/// Sends to all other nodes.
void SharedSession::publish(std::size_t from, const session::ObjectPose& pose) {
  if (from != kHostNode) to_host(from, kSmallBytes, [this, pose] { host_->on_pose(pose, now_ns_); });
  for (std::size_t i = 0; i < hrtcs_.size(); ++i) {
    if (from == kFirstHrtcNode + i) continue;
    to_hrtc(from, i, kSmallBytes, [this, pose](Hrtc& hrtc) { hrtc.core.gateway().on_pose(pose, now_ns_, now_ns_); });
  }
  send(from, kViewerNode, kSmallBytes, [this, pose] { see(pose); });
}

void SharedSession::see(const session::ObjectPose& pose) {
  if (!gate_.accept(pose, now_ns_)) return;
  seen_ = pose;
  session::CatalogueEntry moved = entry_;
  moved.pose = pose.pose;
  view_[entry_.object] = client_sim::view_of(moved);
}

void SharedSession::haptic_cycle(std::size_t i) {
  Hrtc& c = *hrtcs_[i];
  hrtc_service::Servo& servo = c.core.servo();
  for (User& user : users_) {
    if (user.hrtc != i || user.device == nullptr) continue;
    hrtc_service::ProbeInput& input = c.inputs[user.probe];
    input.active = true;
    input.device = user.device->read(now_ns_);
  }
  if (settings_.watch != nullptr) settings_.watch->begins();
  const hrtc_service::Servo::Outputs& outputs = servo.touch(c.inputs, now_ns_);
  for (User& user : users_)
    if (user.hrtc == i && user.device != nullptr) user.device->write(hrtc_service::vec(outputs[user.probe].force));
  servo.publish(now_ns_, now_ns_ + kMs);
  (void)servo.refine(spm::Budget{1u << 20});
  if (settings_.watch != nullptr) settings_.watch->ends();
  if (hrtc_service::BodyReports reports; c.core.link().bodies.reports_for_sender.take(reports)) c.reports = reports;
}

void SharedSession::send_reports(std::size_t i) {
  Hrtc& c = *hrtcs_[i];
  const hrtc_service::BodyReport& body = c.reports.bodies[0];
  if (c.reports.count == 0) return;
  for (std::size_t to = 0; body.copies > 0 && to < hrtcs_.size(); ++to) {
    if (to == i) continue;
    session::ObjectCopy copy;
    sharing::put_sample(body.sample, body.copies, copy);
    const std::int64_t sent_ns = now_ns_;
    to_hrtc(kFirstHrtcNode + i, to, kCopyBytes,
            [this, sent_ns, copy_index = body.place, group = body.group, copy](Hrtc& peer) {
              peer.core.gateway().on_transit(now_ns_ - sent_ns, now_ns_);
              (void)peer.core.link().bodies.copies.push({peer.index, copy_index, group, sharing::sample_of(copy)});
              peer.core.gateway().on_peer_received(peer.index, now_ns_);
            });
  }
  if (body.publish == 0 || now_ns_ - c.posed_ns < hrtc_service::kBodyPoseNs) return;
  c.posed_ns = now_ns_;
  session::ObjectPose pose;
  pose.origin = c.origin;
  pose.object_id = entry_.object_id;
  pose.sequence = ++c.pose_sequence;
  pose.fencing = body.publish;
  pose.session_time_ns = now_ns_;
  sharing::put_state(body.state, shared_.centre, pose);
  publish(kFirstHrtcNode + i, pose);
}

void SharedSession::serve(std::size_t i) {
  Hrtc& c = *hrtcs_[i];
  hrtc_service::Gateway& gateway = c.core.gateway();
  if (host_ != nullptr) gateway.on_host_seen(kHost, entry_.origin.incarnation, now_ns_);
  gateway.tick(now_ns_, session::ClockMap{});
  while (auto demand = gateway.demand(now_ns_)) {
    const std::size_t bytes = kHeads + 100 + 8 * (demand->have.size() + demand->wanted.size() + demand->gaps.size());
    to_host(kFirstHrtcNode + i, bytes, [this, demand = *demand] { host_->on_demand(demand, now_ns_); });
  }
  for (const session::ObjectClaim& claim : gateway.claims())
    to_host(kFirstHrtcNode + i, kSmallBytes, [this, claim] { host_->on_claim(claim, now_ns_); });
}

/// The user receives its probe's state, the other users receive it too, and the user sends its next intent.
void SharedSession::step_user(User& user) {
  if (hrtcs_[user.hrtc]->dead) return;
  if (user.device != nullptr) {
    const hrtc_service::ProbeOutput& output = hrtcs_[user.hrtc]->core.servo().outputs()[user.probe];
    session::ProbeState state;
    state.user_id = user.id;
    state.session_time_ns = now_ns_;
    state.device.position = output.device;
    state.proxy = output.proxy;
    state.force = output.force;
    state.status = output.status;
    state.object_id = output.object != spm::kNone ? entry_.object_id : 0;
    if (user.op != nullptr) user.op->on_probe_state(state);
    for (std::size_t i = 0; i < hrtcs_.size(); ++i) {
      const auto receive = [this, state, i, local = i == user.hrtc](Hrtc& hrtc) {
        if (!local) hrtc.core.gateway().on_transit(now_ns_ - state.session_time_ns, now_ns_);
        for (User& other : users_)
          if (other.hrtc == i && other.op != nullptr) other.op->on_other(state);
      };
      if (i == user.hrtc)
        receive(*hrtcs_[i]);
      else
        to_hrtc(kFirstHrtcNode + user.hrtc, i, kStateBytes, receive);
    }
  }
  if (user.op == nullptr) return;
  const std::optional<session::Intent> intent = user.op->tick(now_ns_, view_);
  if (!intent) return;
  if (user.device == nullptr) {
    sharing::set_start(*intent, user.hand);
    user.device = std::make_unique<haptics::SimulatedDevice>(user.hand);
  }
  user.device->paths().post(sharing::hand_path(*intent, 0));
}

void SharedSession::host_tick() {
  const host_service::HostMessages& messages = host_->tick(now_ns_);
  if (messages.clock_request) set_host_clock(*messages.clock_request);
  for (const session::ObjectGrant& grant : messages.grants)
    for (std::size_t i = 0; i < hrtcs_.size(); ++i)
      to_hrtc(kHostNode, i, kSmallBytes, [this, grant](Hrtc& hrtc) { hrtc.core.gateway().on_grant(grant, now_ns_); });
  for (const session::ObjectPose& pose : messages.poses) publish(kHostNode, pose);
  while (auto out = host_->next_chunk(now_ns_)) {
    const std::uint64_t receiver = out->hrtc;
    if (receiver < 1 || receiver > hrtcs_.size()) continue;
    const std::size_t bytes = kHeads + out->chunk.payload_bytes();
    to_hrtc(kHostNode, receiver - 1, bytes,
            [this, chunk = std::move(out->chunk)](Hrtc& hrtc) { hrtc.core.gateway().on_chunk(chunk, now_ns_); });
  }
}

void SharedSession::step() {
  now_ns_ += kMs;
  for (auto& from : paths_)
    for (Path<Arrive>& path : from)
      while (const auto arrive = path.take(now_ns_)) (*arrive)();
  const bool even = now_ns_ / kMs % 2 == 0;
  for (std::size_t i = 0; i < hrtcs_.size(); ++i) {
    if (hrtcs_[i]->dead) continue;
    haptic_cycle(i);
    send_reports(i);
    if (even) serve(i);
  }
  if (even)
    for (User& user : users_) step_user(user);
  if (host_ != nullptr) host_tick();
}

}  // namespace tactus::study
