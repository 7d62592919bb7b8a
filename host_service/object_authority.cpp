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
  const session::OwnershipArbiter arbiter{self_, entry.object_id, settings_.ownership, now_ns};
  const auto [at, is_new] = objects_.try_emplace(entry.object_id, sharing::body_of(entry), arbiter);
  at->second.shared_object.follow();
  if (!is_new) return;
  at->second.unknown_leases_end_ns = now_ns + settings_.ownership.lease_ns;
  choose_authority(at->second);
}

const ObjectAuthority::PresentHost* ObjectAuthority::find_present(std::uint64_t id, const OtherHost& other) const {
  const auto host = hosts_.find(id);
  return host == hosts_.end() || host->second.incarnation > other.incarnation ? nullptr : &host->second;
}

const ObjectAuthority::PresentHost* ObjectAuthority::other_authority(const Object& object) const {
  const auto self = hosts_.find(self_.participant);
  auto first = std::make_pair(self == hosts_.end() ? session::kNotJoined : self->second.joined_ns, self_.participant);
  const PresentHost* authority = nullptr;
  for (const auto& [id, other] : object.other_hosts) {
    const PresentHost* const host = find_present(id, other);
    if (host == nullptr || std::make_pair(host->joined_ns, id) >= first) continue;
    first = {host->joined_ns, id};
    authority = host;
  }
  return authority;
}

void ObjectAuthority::choose_authority(Object& object) {
  if (other_authority(object) != nullptr) {
    object.arbiter.stand_by();
    object.stop_simulating();
  } else if (object.arbiter.stands_by()) {
    object.arbiter.take_over(object.unknown_leases_end_ns);
  }
}

void ObjectAuthority::choose_authorities() {
  for (auto& [id, object] : objects_) choose_authority(object);
}

void ObjectAuthority::note_leases() {
  for (auto& [id, object] : objects_)
    if (const PresentHost* const host = other_authority(object))
      object.unknown_leases_end_ns =
          std::max(object.unknown_leases_end_ns, host->received_ns + settings_.ownership.lease_ns);
}

void ObjectAuthority::on_catalogue(const session::CatalogueEntry& entry) {
  const std::uint64_t host = entry.origin.participant;
  const auto at = objects_.find(entry.object_id);
  if (at == objects_.end() || host == self_.participant || entry.origin.session != self_.session) return;
  note_leases();
  at->second.other_hosts.erase(host);
  if (!entry.withdrawn && sharing::can_move(entry)) at->second.other_hosts[host] = {entry.origin.incarnation};
  choose_authority(at->second);
}

void ObjectAuthority::on_host(const session::Origin& host, std::int64_t joined_ns, std::int64_t now_ns) {
  const auto [at, is_new] = hosts_.try_emplace(host.participant, PresentHost{host.incarnation, joined_ns, now_ns});
  PresentHost& present = at->second;
  present.received_ns = std::max(present.received_ns, now_ns);
  if (!is_new && present.joined_ns == joined_ns && present.incarnation == host.incarnation) return;
  note_leases();
  present.joined_ns = joined_ns;
  present.incarnation = host.incarnation;
  choose_authorities();
}

void ObjectAuthority::on_host_gone(std::uint64_t host) {
  note_leases();
  if (hosts_.erase(host) > 0) choose_authorities();
}

bool ObjectAuthority::shares_objects() const noexcept {
  return std::any_of(objects_.begin(), objects_.end(), [](const auto& at) { return !at.second.other_hosts.empty(); });
}

void ObjectAuthority::drop_silent_hosts(std::int64_t now_ns) {
  const auto is_silent = [&](const auto& at) {
    return at.first != self_.participant && now_ns - at.second.received_ns >= settings_.silence_ns;
  };
  if (std::none_of(hosts_.begin(), hosts_.end(), is_silent)) return;
  note_leases();
  std::erase_if(hosts_, is_silent);
  choose_authorities();
}

/// Processes the time in which this program did not run.
void ObjectAuthority::wait_after_pause(std::int64_t now_ns) {
  const std::int64_t missed_ns = now_ns - ticked_ns_ - kMaxTickNs;
  ticked_ns_ = now_ns;
  if (missed_ns <= 0) return;
  for (auto& [id, host] : hosts_) host.received_ns = std::min(now_ns, host.received_ns + missed_ns);
  if (missed_ns < settings_.silence_ns - kMaxTickNs) return;
  for (auto& [id, object] : objects_) {  // another host may have taken the object over
    if (object.other_hosts.empty() || object.arbiter.stands_by()) continue;
    object.arbiter.stand_by();
    object.arbiter.take_over(now_ns + settings_.ownership.lease_ns);
    object.stop_simulating();
  }
}

void ObjectAuthority::on_hrtc_gone(std::uint64_t hrtc) {
  for (auto& [id, object] : objects_) object.arbiter.forget(hrtc);
}

void ObjectAuthority::drop_absent(Object& object, std::int64_t now_ns) const {
  for (auto at = object.other_hosts.begin(); at != object.other_hosts.end();) {
    auto& [id, other] = *at;
    if (find_present(id, other) != nullptr)
      other.absent_ns = 0;
    else if (other.absent_ns == 0)
      other.absent_ns = now_ns;
    const bool is_gone = other.absent_ns != 0 && now_ns - other.absent_ns >= kMaxAbsenceNs;
    at = is_gone ? object.other_hosts.erase(at) : std::next(at);
  }
}

void ObjectAuthority::on_claim(const session::ObjectClaim& claim, std::int64_t now_ns) {
  const auto at = objects_.find(claim.object_id);
  if (at != objects_.end()) at->second.arbiter.on_claim(claim, now_ns);
}

void ObjectAuthority::on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns) {
  const auto at = objects_.find(pose.object_id);
  if (at == objects_.end() || pose.origin.participant == self_.participant) return;
  Object& object = at->second;
  if (!object.arbiter.stands_by() && pose.fencing < object.arbiter.fencing()) return;
  if (!object.pose_admission.accept(pose, now_ns)) return;
  if (const auto host = hosts_.find(pose.origin.participant); host != hosts_.end())
    host->second.received_ns = std::max(host->second.received_ns, now_ns);
  if (object.arbiter.on_pose(pose.fencing, now_ns)) object.stop_simulating();
  object.pose_interpolator.on_pose(
      {sharing::state_of(pose, object.body.centre), pose.session_time_ns, ++object.received}, session_now_ns);
}

std::uint64_t ObjectAuthority::implausible() const noexcept {
  std::uint64_t all = 0;
  for (const auto& [id, object] : objects_) all += object.pose_admission.implausible() + object.arbiter.implausible();
  return all;
}

std::uint64_t ObjectAuthority::claims_refused() const noexcept {
  std::uint64_t all = 0;
  for (const auto& [id, object] : objects_) all += object.arbiter.refused();
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
  wait_after_pause(now_ns);
  drop_silent_hosts(now_ns);
  for (auto& [id, object] : objects_) {
    drop_absent(object, now_ns);
    if (auto grant = object.arbiter.tick(now_ns)) messages_.grants.push_back(std::move(*grant));
    if (!object.arbiter.host_simulates()) {
      object.stop_simulating();
      is_any_simulated_elsewhere_ = is_any_simulated_elsewhere_ || !object.arbiter.stands_by();
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
    pose.fencing = object.arbiter.fencing();
    pose.session_time_ns = session_now_ns - (now_ns - object.stepped_ns);
    sharing::put_state(object.shared_object.state(), object.body.centre, pose);
    messages_.poses.push_back(pose);
  }
  if (scenery_ != nullptr && busy_) scenery_->refine_around(contact_points_);
  return messages_;
}

}  // namespace tactus::host_service
