#include "hrtc_service/ownership_client.hpp"

#include <algorithm>

#include "spm/assert.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMaxPeerSilenceNs = 100'000'000;  // silence after which copies without a grant separate
constexpr std::int64_t kWakeUpMarginNs = 4'000'000;      // added to the transit for threads that wake up late

}  // namespace

OwnershipClient::OwnershipClient(const session::Origin& self, SharedMailbox<GrantedBodies>& orders,
                                 const session::OwnershipSettings& settings)
    : self_{self}, settings_{settings}, orders_out_{orders}, pose_number_{MailboxReader{orders}.latest().pose_number} {}

void OwnershipClient::add(std::uint32_t object_index, std::uint64_t object_id, const sharing::SharedBody& body) {
  TACTUS_CHECK(objects_.size() < kMaxBodies);
  objects_.push_back(std::make_unique<Object>(Object{
      object_index, object_id, body, session::Claimant{self_, object_id, settings_}, {}, {}, {}, {}, 0, 0, {}, 0, 0}));
  bodies_.push_back({object_index, object_id, false, sharing::pose_of(body.start, body.centre)});
}

void OwnershipClient::withdraw(std::uint32_t object_index) {
  const auto at =
      std::find_if(objects_.begin(), objects_.end(), [&](const auto& object) { return object->index == object_index; });
  if (at == objects_.end()) return;
  const auto position = at - objects_.begin();
  objects_.erase(at);
  bodies_.erase(bodies_.begin() + position);
  std::move(orders_.bodies.begin() + position + 1, orders_.bodies.end(), orders_.bodies.begin() + position);
  post_orders();
}

OwnershipClient::Object* OwnershipClient::find(std::uint64_t id) {
  const auto at = std::find_if(objects_.begin(), objects_.end(), [&](const auto& object) { return object->id == id; });
  return at == objects_.end() ? nullptr : at->get();
}

void OwnershipClient::on_grant(const session::ObjectGrant& grant, std::int64_t now_ns) {
  if (Object* const object = find(grant.object_id)) object->claimant.on_grant(grant, now_ns);
}

void OwnershipClient::on_pose(const session::ObjectPose& pose, std::int64_t now_ns) {
  Object* const object = find(pose.object_id);
  if (object == nullptr || pose.origin.participant == self_.participant || !object->pose_admission.accept(pose, now_ns))
    return;
  object->claimant.on_pose(pose.fencing, now_ns);
  object->received = {sharing::state_of(pose, object->body.centre), pose.session_time_ns, ++pose_number_};
  post_orders();
}

void OwnershipClient::on_peer_received(std::uint32_t object_index, std::int64_t now_ns) {
  for (const auto& object : objects_)
    if (object->index == object_index) object->peer_received_ns = now_ns;
}

void OwnershipClient::on_transits(const session::TransitEstimator& transits) noexcept {
  // The margin of a fifth is for waves that arrive after the channel's delay, because those exert a wrong force. A
  // larger margin would make the channel heavier and softer, in proportion to the square of its delay.
  transit_with_margin_ns_ = transits.max_ns() + transits.max_ns() / 5 + kWakeUpMarginNs;
}

void OwnershipClient::on_reports(const BodyReports& reports) {
  reports_ = reports;
  for (std::uint32_t i = 0; i < reports.count; ++i) {
    const BodyReport& report = reports.bodies[i];
    const auto at = std::find_if(objects_.begin(), objects_.end(),
                                 [&](const auto& object) { return object->index == report.object; });
    if (at == objects_.end()) continue;
    Object& object = **at;
    object.claimant.set_touching(report.is_touched);
    BodyStatus& status = bodies_[static_cast<std::size_t>(at - objects_.begin())];
    status.is_touched = report.is_touched;
    status.pose = sharing::pose_of(report.state, object.body.centre);
    if (report.copies == 0) continue;
    if (report.coupling_fencing != object.last_fencing) {
      object.last_fencing = report.coupling_fencing;
      object.past_given += object.ledger.given;
      object.past_received += object.ledger.received;
    }
    object.ledger = report.ledger;
    max_separation_ = std::max(max_separation_, object.ledger.copy_distance);
  }
}

void OwnershipClient::update_coupling(Object& object, std::int64_t now_ns) {
  using Role = session::Claimant::Role;
  const Role role = object.claimant.role(now_ns);
  const bool is_coupled = object.coupling.fencing != 0;
  const bool granted = role == Role::kLeader || role == Role::kCopy;
  if (granted && is_coupled && object.coupling.fencing == object.claimant.fencing()) return;
  const bool has_live_peers =
      role == Role::kRequesting && is_coupled && now_ns - object.peer_received_ns < kMaxPeerSilenceNs;
  if (has_live_peers) return;
  object.coupling = {};
  object.group = {};
  if (!granted) return;
  const session::ObjectGrant& grant = object.group = object.claimant.grant();
  object.coupling = {grant.fencing, static_cast<std::uint32_t>(grant.touchers.size()),
                     static_cast<std::uint32_t>(object.claimant.copy_index()),
                     std::clamp(grant.channel_delay_ns, kMinChannelDelayNs, kMaxChannelDelayNs)};
  object.peer_received_ns = now_ns;
  ++couplings_made_;
}

void OwnershipClient::post_orders() {
  orders_.pose_number = pose_number_;
  orders_.count = static_cast<std::uint32_t>(objects_.size());
  for (std::uint32_t i = 0; i < orders_.count; ++i) {
    const Object& object = *objects_[i];
    GrantedBody& order = orders_.bodies[i];
    order.object = object.index;
    order.received = object.received;
    order.coupling = object.coupling;
  }
  orders_out_.post(orders_);
}

std::vector<session::ObjectClaim> OwnershipClient::tick(std::int64_t now_ns, const session::ClockMap& clock) {
  using Role = session::Claimant::Role;
  std::vector<session::ObjectClaim> claims;
  if (objects_.empty()) return claims;
  orders_.clock = clock;
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = *objects_[i];
    object.claimant.set_one_way(transit_with_margin_ns_);
    if (auto claim = object.claimant.tick(now_ns)) claims.push_back(std::move(*claim));
    update_coupling(object, now_ns);
    const Role role = object.claimant.role(now_ns);
    orders_.bodies[i].publish_fencing = role == Role::kOwner || role == Role::kLeader ? object.claimant.fencing() : 0;
  }
  post_orders();
  return claims;
}

const session::ObjectGrant& OwnershipClient::group(std::uint32_t object_index) const {
  static const session::ObjectGrant none;
  for (const auto& object : objects_)
    if (object->index == object_index) return object->group;
  return none;
}

session::Claimant::Role OwnershipClient::role(std::uint32_t object_index, std::int64_t now_ns) const {
  for (const auto& object : objects_)
    if (object->index == object_index) return object->claimant.role(now_ns);
  return session::Claimant::Role::kWatching;
}

std::uint64_t OwnershipClient::implausible() const noexcept {
  std::uint64_t all = 0;
  for (const auto& object : objects_) all += object->claimant.implausible() + object->pose_admission.implausible();
  return all;
}

void OwnershipClient::add_figures(std::vector<session::Figure>& figures) const {
  namespace names = session::figures;
  if (objects_.empty()) return;
  std::uint32_t touched = 0, coupled = 0;
  double tank = 0, received = 0, given = 0, port_energy = 0, port_lowest = 0, withheld = 0;
  for (std::uint32_t i = 0; i < reports_.count; ++i) {
    touched += reports_.bodies[i].is_touched ? 1 : 0;
    coupled += reports_.bodies[i].copies > 0 ? 1 : 0;
  }
  for (const auto& object : objects_) {
    tank += object->ledger.tank;
    received += object->past_received + object->ledger.received;
    given += object->past_given + object->ledger.given;
  }
  for (const auto* const ports : {&reports_.ports, &reports_.rotational_ports})
    for (const haptics::PassivityController::Ledger& port : *ports) {
      port_energy += port.energy;
      port_lowest = std::min(port_lowest, port.lowest);
      withheld += port.withheld;
    }
  const std::pair<const char*, double> all[] = {{names::kBodiesTouched, touched},
                                                {names::kBodiesCoupled, coupled},
                                                {names::kCopyGroups, static_cast<double>(couplings_made_)},
                                                {names::kCopiesApart, 1e6 * max_separation_},
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
