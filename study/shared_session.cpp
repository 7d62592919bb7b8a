#include "study/shared_session.hpp"

#include <algorithm>

#include "hrtc_service/hrtc_core.hpp"
#include "session/figures.hpp"
#include "sharing/hand_path.hpp"

namespace tactus::study {
namespace {

using hrtc_service::kMaxProbes;
using spm::Vec3d;

constexpr std::uint64_t kSession = 30, kHost = 100, kObject = 5;
constexpr std::size_t kHostPlace = 0, kViewerPlace = 1, kFirstPlace = 2;
constexpr std::size_t kHeads = 170;       // bytes around a payload: Ethernet, IP, UDP, RTPS, ours
constexpr std::size_t kSmallBytes = 250;  // a claim, grant or pose, heads and all
constexpr std::size_t kCopyBytes = 400, kStateBytes = 330;

session::Origin origin_of(std::uint64_t participant, std::uint64_t incarnation) {
  return {kSession, participant, incarnation, 0};
}

session::CatalogueEntry entry_for(const Subject& subject, double mass) {
  session::CatalogueEntry entry;
  entry.host = "host";
  entry.object = subject.name;
  entry.object_id = kObject;
  entry.summary = subject.model.summary;
  entry.scale = subject.model.summary.metres_per_unit;
  entry.pose.position = {0, 0, -entry.scale * double{entry.summary.bounds_min[2]}};
  entry.material = {1000, 3, 0.9, 0.8};
  entry.body = {mass, sharing::inertia_of_bounds(entry.summary, entry.scale, mass), 0.6, 0};
  return entry;
}

hrtc_service::HrtcCoreSettings core_settings() {
  hrtc_service::HrtcCoreSettings settings;
  settings.pool = spm::PoolSettings::for_slots(1 << 13);
  settings.servo.cycle.force.soft_start = 0.01;
  return settings;
}

}  // namespace

struct SharedSession::Controller {
  explicit Controller(const session::Origin& self) : origin{self}, core{self, core_settings()} {}

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
    : subject_{subject},
      settings_{settings},
      entry_{entry_for(subject, settings.mass)},
      shared_{sharing::body_of(entry_)} {
  for (const std::size_t place : {kHostPlace, kViewerPlace}) connect(place);
  view_[entry_.object] = client_sim::view_of(entry_);
  start_host();
}
SharedSession::~SharedSession() = default;

/// Ways between the new place and all that are there.
void SharedSession::connect(std::size_t place) {
  const auto way = [&](std::size_t from, std::size_t to) {
    constexpr std::uint64_t kPlaces = 64;
    const auto& profile = from < to ? settings_.link.forth : settings_.link.back;
    return Way<Arrive>{profile, (settings_.seed * kPlaces + from) * kPlaces + to};
  };
  for (std::size_t from = 0; from < place; ++from) ways_[from].push_back(way(from, place));
  ways_.emplace_back();
  for (std::size_t to = 0; to <= place; ++to) ways_[place].push_back(way(place, to));
}

void SharedSession::start_host() {
  // Incarnations are nanoseconds, of which one life uses few as fencing numbers.
  entry_.origin = origin_of(kHost, static_cast<std::uint64_t>(now_ns_));
  object_authority_ = std::make_unique<host_service::ObjectAuthority>(entry_.origin);
  object_authority_->add(entry_, now_ns_);
  server_ = std::make_unique<session::DeliveryServer>(entry_.origin);
  server_->add(kObject, subject_.encoded->coded());
  entry_.base_bytes = server_->base_bytes(kObject);
  ++host_life_;
}

void SharedSession::stop_host() {
  object_authority_.reset();
  server_.reset();
  ++host_life_;
}

std::size_t SharedSession::add_controller() {
  const std::size_t i = controllers_.size();
  controllers_.push_back(std::make_unique<Controller>(origin_of(i + 1, 1)));
  connect(kFirstPlace + i);
  Controller& controller = *controllers_.back();
  hrtc_service::Gateway& gateway = controller.core.gateway();
  gateway.on_object = [&controller](const hrtc_service::TouchObject& object) { controller.index = object.index; };
  gateway.on_host_seen(kHost, entry_.origin.incarnation, now_ns_);
  gateway.on_catalogue(entry_);
  return i;
}

void SharedSession::kill_controller(std::size_t controller) { controllers_[controller]->dead = true; }

std::size_t SharedSession::join(std::size_t controller, User user) {
  user.controller = controller;
  user.probe = controllers_[controller]->probes++;
  user.hand.seed = static_cast<std::uint32_t>(settings_.seed * 64 + users_.size() + 1);
  user.hand.tremor = settings_.tremor;
  users_.push_back(std::move(user));
  return users_.size() - 1;
}

std::size_t SharedSession::add_user(std::size_t controller, const client_sim::User& person) {
  User user;
  user.id = session::id_of(person.name);
  user.mind = std::make_unique<client_sim::Operator>(person, client_sim::OperatorSettings{});
  return join(controller, std::move(user));
}

std::size_t SharedSession::add_hand(std::size_t controller, const Vec3d& start) {
  const std::size_t i = join(controller, {});
  users_[i].id = session::id_of("hand" + std::to_string(i));
  users_[i].hand.start = start;
  users_[i].device = std::make_unique<haptics::SimulatedDevice>(users_[i].hand);
  return i;
}

void SharedSession::move_hand(std::size_t user, const Vec3d& to) {
  haptics::HandPath path;
  path.count = 1;
  path.waypoints[0] = {now_ns_, {to.x(), to.y(), to.z()}};
  users_[user].device->wishes().post(path);
}

const hrtc_service::BodyReport* SharedSession::body(std::size_t controller) const {
  const hrtc_service::BodyReports& reports = controllers_[controller]->reports;
  return reports.count == 0 ? nullptr : &reports.bodies[0];
}

session::Holder::Role SharedSession::role(std::size_t controller) const {
  return controllers_[controller]->core.gateway().ownership().role(controllers_[controller]->index, now_ns_);
}

double SharedSession::figure(std::size_t controller, const std::string& name) const {
  std::vector<session::Figure> figures;
  controllers_[controller]->core.gateway().ownership().write(figures);
  for (const session::Figure& figure : figures)
    if (figure.name == name) return figure.value;
  return 0;
}

const haptics::PassivityController::Ledger& SharedSession::port(std::size_t user) const {
  return controllers_[users_[user].controller]->reports.ports[users_[user].probe];
}

const hrtc_service::ProbeOutput& SharedSession::probe(std::size_t user) const {
  return controllers_[users_[user].controller]->core.servo().outputs()[users_[user].probe];
}

bool SharedSession::done() const {
  return std::all_of(users_.begin(), users_.end(),
                     [](const User& user) { return user.mind == nullptr || user.mind->done(); });
}

void SharedSession::send(std::size_t from, std::size_t to, std::size_t bytes, Arrive arrive) {
  ways_[from][to].send(now_ns_, std::move(arrive), bytes);
}

void SharedSession::to_host(std::size_t from, std::size_t bytes, Arrive arrive) {
  send(from, kHostPlace, bytes, [this, life = host_life_, arrive = std::move(arrive)] {
    if (object_authority_ != nullptr && life == host_life_) arrive();
  });
}

void SharedSession::to_controller(std::size_t from, std::size_t i, std::size_t bytes,
                                  std::function<void(Controller&)> arrive) {
  send(from, kFirstPlace + i, bytes, [this, i, arrive = std::move(arrive)] {
    if (!controllers_[i]->dead) arrive(*controllers_[i]);
  });
}

/// To everybody else.
void SharedSession::publish(std::size_t from, const session::ObjectPose& pose) {
  if (from != kHostPlace)
    to_host(from, kSmallBytes, [this, pose] { object_authority_->on_pose(pose, now_ns_, now_ns_); });
  for (std::size_t i = 0; i < controllers_.size(); ++i) {
    if (from == kFirstPlace + i) continue;
    to_controller(from, i, kSmallBytes,
                  [this, pose](Controller& controller) { controller.core.gateway().on_pose(pose, now_ns_, now_ns_); });
  }
  send(from, kViewerPlace, kSmallBytes, [this, pose] { see(pose); });
}

void SharedSession::see(const session::ObjectPose& pose) {
  if (!gate_.accept(pose, now_ns_)) return;
  seen_ = pose;
  session::CatalogueEntry moved = entry_;
  moved.pose = pose.pose;
  view_[entry_.object] = client_sim::view_of(moved);
}

void SharedSession::haptic_cycle(std::size_t i) {
  Controller& c = *controllers_[i];
  hrtc_service::Servo& servo = c.core.servo();
  for (User& user : users_) {
    if (user.controller != i || user.device == nullptr) continue;
    hrtc_service::ProbeInput& input = c.inputs[user.probe];
    input.active = true;
    input.device = user.device->read(now_ns_);
  }
  if (settings_.watch != nullptr) settings_.watch->begins();
  const hrtc_service::Servo::Outputs& outputs = servo.touch(c.inputs, now_ns_);
  for (User& user : users_)
    if (user.controller == i && user.device != nullptr)
      user.device->write(hrtc_service::vec(outputs[user.probe].force));
  servo.publish(now_ns_, now_ns_ + kMs);
  (void)servo.refine(spm::Budget{1u << 20});
  if (settings_.watch != nullptr) settings_.watch->ends();
  if (hrtc_service::BodyReports reports; c.core.link().bodies.reports_for_sender.take(reports)) c.reports = reports;
}

void SharedSession::send_reports(std::size_t i) {
  Controller& c = *controllers_[i];
  const hrtc_service::BodyReport& body = c.reports.bodies[0];
  if (c.reports.count == 0) return;
  for (std::size_t to = 0; body.copies > 0 && to < controllers_.size(); ++to) {
    if (to == i) continue;
    session::ObjectCopy copy;
    sharing::put_sample(body.sample, body.copies, copy);
    const std::int64_t sent_ns = now_ns_;
    to_controller(kFirstPlace + i, to, kCopyBytes,
                  [this, sent_ns, place = body.place, group = body.group, copy](Controller& peer) {
                    peer.core.gateway().on_transit(now_ns_ - sent_ns, now_ns_);
                    (void)peer.core.link().bodies.copies.push({peer.index, place, group, sharing::sample_of(copy)});
                    peer.core.gateway().on_peer_received(peer.index, now_ns_);
                  });
  }
  if (body.publish == 0 || now_ns_ - c.posed_ns < hrtc_service::kBodyPoseNs) return;
  c.posed_ns = now_ns_;
  session::ObjectPose pose;
  pose.origin = c.origin;
  pose.object_id = kObject;
  pose.sequence = ++c.pose_sequence;
  pose.fencing = body.publish;
  pose.session_time_ns = now_ns_;
  sharing::put_state(body.state, shared_.centre, pose);
  publish(kFirstPlace + i, pose);
}

void SharedSession::serve(std::size_t i) {
  Controller& c = *controllers_[i];
  hrtc_service::Gateway& gateway = c.core.gateway();
  if (object_authority_ != nullptr) gateway.on_host_seen(kHost, entry_.origin.incarnation, now_ns_);
  gateway.tick(now_ns_, session::ClockMap{});
  while (auto demand = gateway.demand(now_ns_)) {
    const std::size_t bytes = kHeads + 100 + 8 * (demand->have.size() + demand->wanted.size() + demand->gaps.size());
    to_host(kFirstPlace + i, bytes, [this, demand = *demand] { (void)server_->on_demand(demand, now_ns_); });
  }
  for (const session::ObjectClaim& claim : gateway.claims())
    to_host(kFirstPlace + i, kSmallBytes, [this, claim] { object_authority_->on_claim(claim, now_ns_); });
}

/// The user feels, all others hear of it, and it wishes.
void SharedSession::act(User& user) {
  if (controllers_[user.controller]->dead) return;
  if (user.device != nullptr) {
    const hrtc_service::ProbeOutput& output = controllers_[user.controller]->core.servo().outputs()[user.probe];
    session::ProbeState state;
    state.user_id = user.id;
    state.session_time_ns = now_ns_;
    state.device.position = output.device;
    state.proxy = output.proxy;
    state.force = output.force;
    state.status = output.status;
    state.object_id = output.object != spm::kNone ? kObject : 0;
    if (user.mind != nullptr) user.mind->on_probe_state(state);
    for (std::size_t i = 0; i < controllers_.size(); ++i) {
      const auto hear = [this, state, i, local = i == user.controller](Controller& controller) {
        if (!local) controller.core.gateway().on_transit(now_ns_ - state.session_time_ns, now_ns_);
        for (User& other : users_)
          if (other.controller == i && other.mind != nullptr) other.mind->on_other(state);
      };
      if (i == user.controller)
        hear(*controllers_[i]);
      else
        to_controller(kFirstPlace + user.controller, i, kStateBytes, hear);
    }
  }
  if (user.mind == nullptr) return;
  const std::optional<session::Intent> intent = user.mind->tick(now_ns_, view_);
  if (!intent) return;
  if (user.device == nullptr) {
    sharing::begin_at(*intent, user.hand);
    user.device = std::make_unique<haptics::SimulatedDevice>(user.hand);
  }
  user.device->wishes().post(sharing::hand_path(*intent, 0));
}

void SharedSession::host_tick() {
  const host_service::ObjectAuthority::Messages& messages = object_authority_->tick(now_ns_, now_ns_);
  for (const session::ObjectGrant& grant : messages.grants)
    for (std::size_t i = 0; i < controllers_.size(); ++i)
      to_controller(kHostPlace, i, kSmallBytes,
                    [this, grant](Controller& controller) { controller.core.gateway().on_grant(grant, now_ns_); });
  for (const session::ObjectPose& pose : messages.poses) publish(kHostPlace, pose);
  while (auto out = server_->next(now_ns_)) {
    const std::uint64_t hrtc = out->hrtc;
    if (hrtc < 1 || hrtc > controllers_.size()) continue;
    const std::size_t bytes = kHeads + out->chunk.payload_bytes();
    to_controller(kHostPlace, hrtc - 1, bytes, [this, chunk = std::move(out->chunk)](Controller& controller) {
      controller.core.gateway().on_chunk(chunk, now_ns_);
    });
  }
}

void SharedSession::step() {
  now_ns_ += kMs;
  for (auto& from : ways_)
    for (Way<Arrive>& way : from)
      while (const auto arrive = way.take(now_ns_)) (*arrive)();
  const bool even = now_ns_ / kMs % 2 == 0;
  for (std::size_t i = 0; i < controllers_.size(); ++i) {
    if (controllers_[i]->dead) continue;
    haptic_cycle(i);
    send_reports(i);
    if (even) serve(i);
  }
  if (even)
    for (User& user : users_) act(user);
  if (object_authority_ != nullptr) host_tick();
}

}  // namespace tactus::study
