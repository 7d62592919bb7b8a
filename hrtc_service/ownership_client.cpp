#include "hrtc_service/ownership_client.hpp"

#include <algorithm>

namespace tactus::hrtc_service {
namespace {

// N/m: it lets the copies of two users who press with 6 N from opposite sides differ by 1.2 mm.
constexpr double kStiffness = 10'000;
constexpr std::int64_t kPeerNs = 100'000'000;  // of silence after which copies without a grant separate
constexpr std::int64_t kMarginNs = 4'000'000;  // beyond the transit: threads that are woken late
constexpr std::int64_t kMinLineNs = 3'000'000, kMaxLineNs = 400'000'000;  // limited by the histories and by stability

}  // namespace

OwnershipClient::OwnershipClient(const session::Origin& self, haptics::Mailbox<BodyOrders>& orders,
                                 const session::OwnershipSettings& settings)
    : self_{self}, settings_{settings}, orders_out_{orders} {}

bool OwnershipClient::add(std::uint32_t object_index, std::uint64_t object_id, const sharing::SharedBody& body) {
  if (objects_.size() == kMaxBodies) return false;
  objects_.push_back(std::make_unique<Object>(
      Object{object_index, object_id, body, session::Holder{self_, object_id, settings_}, {}, {}, {}, 0, 0, {}, 0, 0}));
  shown_.push_back({object_index, object_id, false, sharing::pose_of(body.start, body.centre)});
  return true;
}

void OwnershipClient::withdraw(std::uint32_t object_index) {
  const auto at =
      std::find_if(objects_.begin(), objects_.end(), [&](const auto& object) { return object->index == object_index; });
  if (at == objects_.end()) return;
  const auto place = at - objects_.begin();
  withdrawn_[object_index] = std::move(*at);
  objects_.erase(at);
  shown_.erase(shown_.begin() + place);
  std::move(orders_.bodies.begin() + place + 1, orders_.bodies.end(), orders_.bodies.begin() + place);
  post();
}

OwnershipClient::Object* OwnershipClient::find(std::uint64_t id) {
  const auto at = std::find_if(objects_.begin(), objects_.end(), [&](const auto& object) { return object->id == id; });
  return at == objects_.end() ? nullptr : at->get();
}

void OwnershipClient::on_grant(const session::ObjectGrant& grant, std::int64_t now_ns) {
  if (Object* const object = find(grant.object_id)) object->holder.on_grant(grant, now_ns);
}

void OwnershipClient::on_pose(const session::ObjectPose& pose, std::int64_t now_ns) {
  Object* const object = find(pose.object_id);
  if (object == nullptr || pose.origin.participant == self_.participant || !object->gate.accept(pose, now_ns)) return;
  object->holder.on_pose(pose.fencing, now_ns);
  object->received = {sharing::state_of(pose, object->body.centre), pose.session_time_ns, object->received.number + 1};
  post();
}

void OwnershipClient::on_peer_received(std::uint32_t object_index, std::int64_t now_ns) {
  for (const auto& object : objects_)
    if (object->index == object_index) object->peer_received_ns = now_ns;
}

void OwnershipClient::on_transits(const session::TransitEstimator& transits) noexcept {
  // A fifth more: waves that arrive too late pull. A larger margin would cost mass and stiffness of the wave-variable
  // channel, which change with the square of its delay.
  one_way_ns_ = transits.max_ns() + transits.max_ns() / 5 + kMarginNs;
}

void OwnershipClient::on_reports(const BodyReports& reports) {
  reports_ = reports;
  for (std::uint32_t i = 0; i < reports.count; ++i) {
    const BodyReport& report = reports.bodies[i];
    const auto at = std::find_if(objects_.begin(), objects_.end(),
                                 [&](const auto& object) { return object->index == report.object; });
    if (at == objects_.end()) continue;
    Object& object = **at;
    object.holder.set_touching(report.held);
    while (!object.groups.empty() && object.groups.front().unused_from != 0 &&
           object.groups.front().unused_from <= reports.orders_seen)
      object.groups.pop_front();
    Held& shown = shown_[static_cast<std::size_t>(at - objects_.begin())];
    shown.held = report.held;
    shown.pose = sharing::pose_of(report.state, object.body.centre);
    if (report.copies == 0) continue;
    if (report.group != object.last_group) {
      object.last_group = report.group;
      object.given_before += object.ledger.given;
      object.received_before += object.ledger.received;
    }
    object.ledger = report.ledger;
    apart_max_ = std::max(apart_max_, object.ledger.apart);
  }
}

void OwnershipClient::choose_group(Object& object, std::int64_t now_ns) {
  using Role = session::Holder::Role;
  const Role role = object.holder.role(now_ns);
  Group* const current =
      !object.groups.empty() && object.groups.back().unused_from == 0 ? &object.groups.back() : nullptr;
  const bool granted = role == Role::kLeader || role == Role::kCopy;
  if (granted && current != nullptr && current->fencing == object.holder.fencing()) return;
  const bool alone = role == Role::kRequesting && current != nullptr && now_ns - object.peer_received_ns < kPeerNs;
  if (alone) return;
  if (current != nullptr) current->unused_from = orders_.number + 1;
  if (!granted) return;
  const session::ObjectGrant& grant = object.holder.grant();
  haptics::CouplingSettings settings;
  settings.copies = grant.touchers.size();
  settings.stiffness = kStiffness;
  settings.delay = 1e-9 * static_cast<double>(std::clamp(grant.channel_delay_ns, kMinLineNs, kMaxLineNs));
  object.groups.push_back(
      {grant.fencing,
       std::make_unique<haptics::CopyCoupling>(settings, object.holder.copy_index(), object.body.settings), 0});
  object.peer_received_ns = now_ns;
  ++groups_made_;
}

void OwnershipClient::post() {
  ++orders_.number;
  orders_.count = static_cast<std::uint32_t>(objects_.size());
  for (std::uint32_t i = 0; i < orders_.count; ++i) {
    const Object& object = *objects_[i];
    BodyOrder& order = orders_.bodies[i];
    order.object = object.index;
    order.received = object.received;
    const Group* const current =
        !object.groups.empty() && object.groups.back().unused_from == 0 ? &object.groups.back() : nullptr;
    order.coupling = current == nullptr ? nullptr : current->coupling.get();
    order.group = current == nullptr ? 0 : current->fencing;
  }
  orders_out_.post(orders_);
}

std::vector<session::ObjectClaim> OwnershipClient::tick(std::int64_t now_ns, const session::ClockMap& clock) {
  using Role = session::Holder::Role;
  std::vector<session::ObjectClaim> claims;
  if (objects_.empty()) return claims;
  orders_.clock = clock;
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = *objects_[i];
    object.holder.set_one_way(one_way_ns_);
    if (auto claim = object.holder.tick(now_ns)) claims.push_back(std::move(*claim));
    choose_group(object, now_ns);
    const Role role = object.holder.role(now_ns);
    orders_.bodies[i].publish = role == Role::kOwner || role == Role::kLeader ? object.holder.fencing() : 0;
  }
  post();
  return claims;
}

session::Holder::Role OwnershipClient::role(std::uint32_t object_index, std::int64_t now_ns) const {
  for (const auto& object : objects_)
    if (object->index == object_index) return object->holder.role(now_ns);
  return session::Holder::Role::kWatching;
}

std::uint64_t OwnershipClient::implausible() const noexcept {
  std::uint64_t all = 0;
  for (const auto& object : objects_) all += object->holder.implausible() + object->gate.implausible();
  return all;
}

void OwnershipClient::write(std::vector<session::Figure>& figures) const {
  namespace names = session::figures;
  if (objects_.empty()) return;
  std::uint32_t held = 0, coupled = 0;
  double tank = 0, received = 0, given = 0, port_energy = 0, port_lowest = 0, withheld = 0;
  for (std::uint32_t i = 0; i < reports_.count; ++i) {
    held += reports_.bodies[i].held ? 1 : 0;
    coupled += reports_.bodies[i].copies > 0 ? 1 : 0;
  }
  for (const auto& object : objects_) {
    tank += object->ledger.tank;
    received += object->received_before + object->ledger.received;
    given += object->given_before + object->ledger.given;
  }
  for (const auto* const ports : {&reports_.ports, &reports_.turns})
    for (const haptics::PassivityController::Ledger& port : *ports) {
      port_energy += port.energy;
      port_lowest = std::min(port_lowest, port.lowest);
      withheld += port.withheld;
    }
  const std::pair<const char*, double> all[] = {{names::kBodiesHeld, held},
                                                {names::kBodiesCoupled, coupled},
                                                {names::kCopyGroups, static_cast<double>(groups_made_)},
                                                {names::kCopiesApart, 1e6 * apart_max_},
                                                {names::kCopyGiven, 1e6 * given},
                                                {names::kCopyReceived, 1e6 * received},
                                                {names::kCopyTank, 1e6 * tank},
                                                {names::kGrabs, static_cast<double>(reports_.grabs)},
                                                {names::kGrabsRefused, static_cast<double>(reports_.refused)},
                                                {names::kPortEnergy, 1e6 * port_energy},
                                                {names::kPortLowest, 1e6 * port_lowest},
                                                {names::kPortWithheld, 1e6 * withheld}};
  for (const auto& [name, value] : all) figures.push_back({name, value});
}

}  // namespace tactus::hrtc_service
