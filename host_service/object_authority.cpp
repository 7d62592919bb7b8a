#include "host_service/object_authority.hpp"

#include <algorithm>

namespace tactus::host_service {

namespace {

constexpr std::int64_t kSimulationStepNs = 1'000'000;
constexpr std::int64_t kMaxTickNs = 50'000'000;  // max time that one tick simulates
/// Time after which an absent host no longer counts as a host of an object. It is longer than the DDS lease, because a
/// host that returns within the lease does not send its catalogue again.
constexpr std::int64_t kMaxAbsenceNs = 10'000'000'000;

}  // namespace

void ObjectAuthority::add(const session::CatalogueEntry& entry, std::int64_t now_ns) {
  if (!sharing::can_move(entry)) return;
  const sharing::SharedBody body = sharing::body_of(entry);
  const auto [at, is_new] = objects_.try_emplace(entry.object_id, body);
  at->second.shared_object.follow();
  if (is_new) choose_authority(entry.object_id, at->second, now_ns);
}

void ObjectAuthority::choose_authority(std::uint64_t id, Object& object, std::int64_t now_ns) {
  const auto rank = [&](std::uint64_t host) {
    const auto at = hosts_.find(host);
    return std::make_pair(at == hosts_.end() ? session::kNotJoined : at->second, host);
  };
  const bool other_is_authority = std::any_of(
      object.other_hosts.begin(), object.other_hosts.end(),
      [&](const auto& other) { return hosts_.count(other.first) != 0 && rank(other.first) < rank(self_.participant); });
  if (other_is_authority) {
    object.arbiter.reset();
    if (object.is_simulated_here) object.shared_object.follow();
    object.is_simulated_here = false;
  } else if (object.arbiter == nullptr) {
    object.arbiter = std::make_unique<session::OwnershipArbiter>(self_, id, settings_.ownership, now_ns,
                                                                 object.pose_admission.confirmed_fencing());
  }
}

void ObjectAuthority::on_catalogue(const session::CatalogueEntry& entry, std::int64_t now_ns) {
  const std::uint64_t host = entry.origin.participant;
  const auto at = objects_.find(entry.object_id);
  if (at == objects_.end() || host == self_.participant || entry.origin.session != self_.session) return;
  at->second.other_hosts.erase(host);
  if (!entry.withdrawn) at->second.other_hosts[host] = 0;
  choose_authority(at->first, at->second, now_ns);
}

void ObjectAuthority::choose_authorities(std::int64_t now_ns) {
  for (auto& [id, object] : objects_) choose_authority(id, object, now_ns);
}

void ObjectAuthority::on_host(std::uint64_t host, std::int64_t joined_ns, std::int64_t now_ns) {
  const auto [at, is_new] = hosts_.try_emplace(host, joined_ns);
  if (!is_new && at->second == joined_ns) return;
  at->second = joined_ns;
  choose_authorities(now_ns);
}

void ObjectAuthority::on_host_gone(std::uint64_t host, std::int64_t now_ns) {
  if (hosts_.erase(host) > 0) choose_authorities(now_ns);
}

void ObjectAuthority::on_hrtc_gone(std::uint64_t hrtc) {
  for (auto& [id, object] : objects_)
    if (object.arbiter != nullptr) object.arbiter->forget(hrtc);
}

void ObjectAuthority::drop_absent(Object& object, std::int64_t now_ns) const {
  for (auto at = object.other_hosts.begin(); at != object.other_hosts.end();) {
    auto& [host, absent_ns] = *at;
    if (hosts_.count(host) != 0)
      absent_ns = 0;
    else if (absent_ns == 0)
      absent_ns = now_ns;
    at = absent_ns != 0 && now_ns - absent_ns >= kMaxAbsenceNs ? object.other_hosts.erase(at) : std::next(at);
  }
}

void ObjectAuthority::on_claim(const session::ObjectClaim& claim, std::int64_t now_ns) {
  const auto at = objects_.find(claim.object_id);
  if (at != objects_.end() && at->second.arbiter != nullptr) at->second.arbiter->on_claim(claim, now_ns);
}

void ObjectAuthority::on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns) {
  const auto at = objects_.find(pose.object_id);
  if (at == objects_.end() || pose.origin.participant == self_.participant) return;
  Object& object = at->second;
  if (object.arbiter != nullptr && pose.fencing < object.arbiter->fencing()) return;
  if (!object.pose_admission.accept(pose, now_ns)) return;
  if (object.arbiter != nullptr) object.arbiter->on_pose(pose.fencing, now_ns);
  object.pose_interpolator.on_pose(
      {sharing::state_of(pose, object.body.centre), pose.session_time_ns, ++object.received}, session_now_ns);
}

std::uint64_t ObjectAuthority::implausible() const noexcept {
  std::uint64_t all = 0;
  for (const auto& [id, object] : objects_)
    all += object.pose_admission.implausible() + (object.arbiter == nullptr ? 0 : object.arbiter->implausible());
  return all;
}

std::uint64_t ObjectAuthority::claims_refused() const noexcept {
  std::uint64_t all = 0;
  for (const auto& [id, object] : objects_) all += object.arbiter == nullptr ? 0 : object.arbiter->refused();
  return all;
}

void ObjectAuthority::simulate(Object& object, std::int64_t now_ns, std::int64_t session_now_ns) {
  if (!object.is_simulated_here) {
    object.is_simulated_here = true;
    object.shared_object.set_state(object.pose_interpolator.state_at(session_now_ns));
    object.shared_object.simulate_alone();
    object.stepped_ns = now_ns;
    object.published_ns = now_ns - settings_.rest_ns;
  }
  object.stepped_ns = std::max(object.stepped_ns, now_ns - kMaxTickNs);
  const haptics::Surroundings around{true, object.body.ground, scenery_ == nullptr ? nullptr : &scenery_->surface()};
  while (object.stepped_ns + kSimulationStepNs <= now_ns) {
    object.stepped_ns += kSimulationStepNs;
    if (object.shared_object.is_asleep()) continue;
    object.shared_object.step(session_now_ns, {}, around, 1e-9 * static_cast<double>(kSimulationStepNs));
    ++steps_;
  }
  for (const haptics::Contact& contact : object.shared_object.static_contacts())
    contact_points_.push_back(contact.point);
  object.pose_interpolator.set_state(object.shared_object.state(), session_now_ns);
}

const ObjectAuthority::Messages& ObjectAuthority::tick(std::int64_t now_ns, std::int64_t session_now_ns) {
  messages_.grants.clear();
  messages_.poses.clear();
  busy_ = is_any_simulated_elsewhere_ = false;
  contact_points_.clear();
  for (auto& [id, object] : objects_) {
    drop_absent(object, now_ns);
    if (object.arbiter == nullptr) continue;
    if (auto grant = object.arbiter->tick(now_ns)) messages_.grants.push_back(std::move(*grant));
    if (!object.arbiter->host_simulates(now_ns)) {
      if (object.is_simulated_here) object.shared_object.follow();
      object.is_simulated_here = false;
      is_any_simulated_elsewhere_ = true;
      continue;
    }
    const bool was_asleep = object.is_simulated_here && object.shared_object.is_asleep();
    simulate(object, now_ns, session_now_ns);
    const bool asleep = object.shared_object.is_asleep();
    busy_ = busy_ || !asleep;
    const std::int64_t period_ns = asleep && was_asleep ? settings_.rest_ns : settings_.pose_ns;
    if (now_ns - object.published_ns < period_ns) continue;
    object.published_ns = now_ns;
    session::ObjectPose pose;
    pose.origin = self_;
    pose.origin.time_ns = now_ns;
    pose.object_id = id;
    pose.sequence = ++object.sequence;
    pose.fencing = object.arbiter->fencing();
    pose.session_time_ns = session_now_ns - (now_ns - object.stepped_ns);
    sharing::put_state(object.shared_object.state(), object.body.centre, pose);
    messages_.poses.push_back(pose);
  }
  if (scenery_ != nullptr && busy_) scenery_->refine_around(contact_points_);
  return messages_;
}

}  // namespace tactus::host_service
