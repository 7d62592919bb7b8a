#include "hrtc_service/membership.hpp"

#include <algorithm>
#include <span>
#include <stdexcept>
#include <utility>

#include "session/time_reference.hpp"
#include "session/units.hpp"

namespace tactus::hrtc_service {
namespace {

using session::Severity;

constexpr std::int64_t kHeartbeatNs = 100 * kMs;
constexpr std::int64_t kClockNs = 200 * kMs, kClockFastNs = 20 * kMs;
constexpr std::uint32_t kFastClockRequests = 10;
constexpr std::int64_t kModesNs = 20 * kMs;
constexpr std::int64_t kWatchNs = 2 * kMs, kRelaxedWatchNs = 4 * kMs;
// Time for which a force counts as on after its end, because a tip may bounce and a hand may close again.
constexpr std::int64_t kForceHoldNs = 200 * kMs;
// Time for which a user keeps its probe although no program lists it.
constexpr std::int64_t kUnlistedNs = session::RosterSettings{}.gone_ns;
constexpr std::uint32_t kClockIsSetUs = 1'000'000;  // larger time bounds mean that the sender's clock is not set

/// Returns whether a probe has a force, a contact or a hold. The force of a contact or hold may be zero in one cycle.
bool has_force(const ProbeReports& reports) {
  return std::any_of(reports.probes.begin(), reports.probes.end(), [](const ProbeOutput& probe) {
    return probe.active && ((probe.status & (session::kInContact | session::kHolding)) != 0 ||
                            probe.force != Plain3{} || probe.torque != Plain3{});
  });
}

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Without the probes that --users no longer permits.
std::span<const std::uint64_t> earlier_users(const MembershipSettings& settings) noexcept {
  return std::span{settings.earlier_users}.first(std::min(settings.max_users, kMaxProbes));
}

}  // namespace

Membership::Membership(const session::Origin& self, const MembershipSettings& settings, Gateway& gateway,
                       std::int64_t now_ns)
    : self_{self},
      settings_{settings},
      gateway_{gateway},
      roster_{self, {}},
      clock_{self, {}, now_ns},
      failure_detector_{self, {}},
      remote_users_{self.participant},
      user_table_{std::min(settings.max_users, kMaxProbes), earlier_users(settings)},
      heartbeat_{kHeartbeatNs},
      clock_request_{kClockFastNs},
      modes_{kModesNs},
      objects_moved_{kModesNs},
      last_force_ns_{now_ns - kForceHoldNs} {
  gateway_.on_object_found = [this](const session::CatalogueEntry& entry) { remote_users_.on_catalogue(entry); };
  gateway_.on_object_gone = [this](const Loader::ObjectInfo& object) {
    remote_users_.on_object_gone(object.id);
    serving_.erase(object.id);
    if (on_object_gone) on_object_gone(object);
  };
}

bool Membership::is_force_on(std::int64_t now_ns) const noexcept { return now_ns - last_force_ns_ < kForceHoldNs; }

void Membership::on_roster(const session::RosterEntry& entry, std::int64_t now_ns) {
  for (const session::RosterEvent& event : roster_.on_entry(entry, now_ns)) on_event(event, now_ns);
  const session::RosterEntry* const recorded = roster_.find(entry.origin.participant);
  const bool is_valid =
      recorded != nullptr && recorded->origin.incarnation == entry.origin.incarnation && !entry.leaving;
  if (entry.role == session::Role::kClient) renew_users(entry);
  if (entry.role != session::Role::kHost || !is_valid) return;
  has_found_host_ = true;
  gateway_.on_host_heartbeat(entry.origin.participant, entry.origin.incarnation, now_ns);
}

void Membership::on_event(const session::RosterEvent& event, std::int64_t) {
  using session::RosterChange;
  const session::RosterEntry& entry = event.entry;
  const std::uint64_t participant = entry.origin.participant;
  if (event.change != RosterChange::kChanged) report(session::severity(event), session::text(event));
  output.scene_changed = true;
  const bool is_new = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted;
  if (entry.role == session::Role::kHost && is_new)
    heartbeat_.repeat_soon();  // the host may not have received our entry
  if (event.change == RosterChange::kNameConflict && participant == self_.participant) {
    if (event.entry_must_leave) report(Severity::kError, session::name_taken_text(settings_.name, settings_.session));
    output.name_conflict = output.name_conflict || event.entry_must_leave;
    return;
  }
  const bool is_gone = event.change == RosterChange::kGone || event.change == RosterChange::kLeft;
  if (entry.role == session::Role::kHost && is_gone) gateway_.on_host_gone(participant);
  if (entry.role == session::Role::kHost && event.change == RosterChange::kLeft)
    gateway_.on_host_left(participant, entry.origin.incarnation);
  if (entry.role == session::Role::kHrtc && is_gone) remote_users_.on_hrtc_gone(participant);
  if (entry.role == session::Role::kClient) on_client(event, is_gone);
}

/// Removes the users of clients to which `departed` applies. Returns the clients of these users.
template <class Departed>
std::vector<std::uint64_t> Membership::remove_users(Departed&& departed) {
  std::vector<std::pair<std::uint64_t, std::string>> removed;
  for (const auto& [probe, user] : users_)
    if (user.client != 0 && departed(user)) removed.emplace_back(user.client, user.name);
  std::vector<std::uint64_t> clients;
  for (const auto& [client, name] : removed) {
    if (clients.empty() || clients.back() != client) clients.push_back(client);
    remove_user(client, name);
  }
  return clients;
}

void Membership::on_client(const session::RosterEvent& event, bool is_gone) {
  using session::RosterChange;
  const session::RosterEntry& entry = event.entry;
  const std::uint64_t client = entry.origin.participant;
  if (is_gone)  // a leave message need not list users
    (void)remove_users(
        [&](const User& user) { return user.client == client && user.incarnation == entry.origin.incarnation; });
  if (event.change == RosterChange::kRestarted)
    (void)remove_users([&](const User& user) { return user.client == client && contains(entry.users, user.name); });
  const bool is_present = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted ||
                          event.change == RosterChange::kChanged;
  const bool has_chosen_us = is_present && entry.requested_hrtc == settings_.name;
  // After a restart, users that the new entry does not name remain at first, because the new program may be in a name
  // conflict and leave again. `remove_unlisted` removes them.
  if (event.change == RosterChange::kChanged)
    (void)remove_users([&](const User& user) {
      return user.client == client && !(has_chosen_us && contains(entry.users, user.name));
    });
  if (!has_chosen_us) return;
  add_users(entry);
  heartbeat_.make_due();
}

void Membership::add_users(const session::RosterEntry& client) {
  for (const std::string& name : client.users) {
    const auto taken = std::find_if(users_.begin(), users_.end(), [&](const auto& u) { return u.second.name == name; });
    if (taken != users_.end()) {
      if (taken->second.client == client.origin.participant)
        taken->second.incarnation = client.origin.incarnation;
      else
        report(Severity::kWarning, "user " + name + " of client " + client.name +
                                       " refused: another user of that name has probe " + std::to_string(taken->first));
      continue;
    }
    if (settings_.may_serve && !settings_.may_serve(name, client.origin.participant)) {
      report(Severity::kWarning, "user " + name + " of client " + client.name +
                                     " refused: the keys of this HRTC do not permit it to serve the user");
      continue;
    }
    const std::optional<std::uint32_t> probe = user_table_.grant(name);
    if (!probe) {
      report(Severity::kWarning, "user " + name + " refused: all " + std::to_string(user_table_.list().size()) +
                                     " probes are taken; raise --users");
      continue;
    }
    users_[*probe] = {name, session::id_of(name), client.origin.participant, client.origin.incarnation, std::nullopt};
    output.users.push_back({true, *probe, session::id_of(name), client.origin.participant, name});
    report(Severity::kInfo, "user " + name + " has probe " + std::to_string(*probe));
  }
}

/// Records that a program still lists its users, also if a newer program has the same name.
void Membership::renew_users(const session::RosterEntry& client) {
  if (client.leaving || client.origin.session != self_.session || client.protocol != session::kProtocolVersion ||
      client.requested_hrtc != settings_.name)
    return;
  for (auto& [probe, user] : users_)
    if (user.client == client.origin.participant && contains(client.users, user.name)) user.unlisted_ns.reset();
}

/// Removes users whose program has ended without an event that names them: a newer program with other users has
/// replaced it.
void Membership::remove_unlisted(std::int64_t now_ns) {
  const auto entry_of = [&](std::uint64_t client) {
    const session::RosterEntry* const entry = roster_.find(client);
    return entry != nullptr && entry->requested_hrtc == settings_.name ? entry : nullptr;
  };
  for (auto& [probe, user] : users_) {
    const session::RosterEntry* const entry = entry_of(user.client);
    if (entry != nullptr && contains(entry->users, user.name))
      user.unlisted_ns.reset();
    else if (!user.unlisted_ns)
      user.unlisted_ns = now_ns;
  }
  const std::vector<std::uint64_t> clients =
      remove_users([&](const User& user) { return user.unlisted_ns && now_ns - *user.unlisted_ns >= kUnlistedNs; });
  for (const std::uint64_t client : clients)  // other users of the same client may have been refused
    if (const session::RosterEntry* const entry = entry_of(client)) add_users(*entry);
}

void Membership::remove_user(std::uint64_t client, const std::string& name) {
  const auto at = std::find_if(users_.begin(), users_.end(), [&](const auto& user) {
    return user.second.name == name && user.second.client == client;
  });
  if (at == users_.end()) return;
  const auto [probe, user] = *at;
  users_.erase(at);
  user_table_.release(name);
  remote_users_.on_user_left(user.id);
  output.users.push_back({false, probe, user.id, client, name});
  report(Severity::kInfo, "user " + name + " has left");
  roster_.for_each(
      [&](const session::RosterEntry& other) {  // users who were refused may now get this probe or this name
        if (other.role == session::Role::kClient && other.requested_hrtc == settings_.name &&
            other.origin.participant != client)
          add_users(other);
      });
  heartbeat_.make_due();
}

std::optional<std::uint32_t> Membership::add_local(const std::string& name) {
  const std::optional<std::uint32_t> probe = user_table_.grant(name);
  if (probe) users_[*probe] = {name, session::id_of(name), 0};
  return probe;
}

void Membership::on_catalogue(const session::CatalogueEntry& entry) {
  heartbeat_.repeat_soon();  // a host opens the endpoints for an HRTC when it has received the HRTC's entry
  gateway_.on_catalogue(entry);
  if (gateway_.loader().has_object(entry.object_id)) remote_users_.on_catalogue(entry);
}

void Membership::on_clock(const session::ClockSample& sample, std::int64_t arrived_ns, std::int64_t now_ns) {
  if (sample.peer != self_.participant) return;
  if (sample.answer) {
    clock_.on_answer(sample, arrived_ns);
    return;
  }
  if (clock_.answers_requests()) output.clock.push_back(clock_.answer(sample, arrived_ns, now_ns));
}

void Membership::on_host_answer(const session::ClockSample& answer, std::int64_t now_ns) {
  failure_detector_.on_answer(answer, now_ns);
  clock_.on_answer(answer, now_ns);
}

void Membership::on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns) {
  const std::int64_t session_ns = clock().session_time(now_ns);
  remote_users_.on_state(state, stream, now_ns, session_ns);
  if (state.time_bound_us < kClockIsSetUs) gateway_.on_transit(session_ns - state.session_time_ns, session_ns);
}

void Membership::on_mode(const std::string& text) {
  try {
    remote_users_.on_mode(text);
    report(Severity::kInfo, "mode: " + text);
  } catch (const std::invalid_argument& error) {
    report(Severity::kWarning, error.what());
  }
}

void Membership::on_stops(const std::vector<session::StopRecord>& stops) {
  stops_ = stops;
  heartbeat_.make_due();
}

void Membership::tick(std::int64_t now_ns) {
  for (const session::RosterEvent& event : roster_.tick(now_ns)) on_event(event, now_ns);
  remove_unlisted(now_ns);
  track_forces(now_ns);
  choose_hosts_to_watch();
  report_host_changes(now_ns);
  session::update_session_clock(roster_, self_, session::Role::kHrtc, is_force_on(now_ns), now_ns, clock_);
  if (objects_moved_.due(now_ns))
    for (const session::CatalogueEntry& entry : gateway_.collect_moved()) remote_users_.on_catalogue(entry);
  if (modes_.due(now_ns)) {
    for (const auto& [probe, user] : users_)
      if (const ProbeOutput& own = gateway_.reports().probes[probe]; own.active)
        remote_users_.on_own_probe(user.id, own.device, now_ns);
    remote_users_.tick(now_ns);
  }
  if (heartbeat_.due(now_ns)) output.roster = roster_entry(false, now_ns);
}

/// Sends a roster entry at once when a force begins, because the time reference must not step while a force is on.
void Membership::track_forces(std::int64_t now_ns) {
  if (!gateway_.has_new_reports() || !has_force(gateway_.reports())) return;
  if (!is_force_on(now_ns)) heartbeat_.make_due();
  last_force_ns_ = now_ns;
}

void Membership::choose_hosts_to_watch() {
  std::uint64_t objects_near = 0;
  for (const NearObjects& of_probe : gateway_.near_objects()) objects_near |= of_probe.found;
  std::vector<std::uint64_t> hosts;
  for (const Loader::ObjectInfo& object : gateway_.loader().objects()) {
    const std::uint64_t host = gateway_.loader().serving_host(object.id);
    if (host != 0 && (objects_near >> object.index & 1u) != 0) hosts.push_back(host);
  }
  failure_detector_.watch(hosts);
}

std::int64_t Membership::watch_period_ns() const noexcept {
  if (!failure_detector_.watches()) return 0;
  return failure_detector_.all_answered() ? kRelaxedWatchNs : kWatchNs;
}

bool Membership::watch_hosts(std::int64_t now_ns) {
  while (auto request = failure_detector_.next_request(now_ns)) output.clock_to_host.push_back(*request);
  const std::vector<session::FailureDetector::Suspect> suspects = failure_detector_.take_suspects(now_ns);
  for (const session::FailureDetector::Suspect& suspect : suspects) {
    report(Severity::kWarning, "host '" + host_name(suspect.host) + "' has not answered for " +
                                   std::to_string(suspect.silent_ns / kMs) + " ms");
    gateway_.on_host_silent(suspect.host);
  }
  return !suspects.empty();
}

std::string Membership::host_name(std::uint64_t host) const {
  const session::RosterEntry* const entry = roster_.find(host);
  return entry == nullptr ? "?" : entry->name;
}

/// Reports an event when another host serves an object, and one when its first records have arrived.
void Membership::report_host_changes(std::int64_t now_ns) {
  for (const Loader::ObjectInfo& object : gateway_.loader().objects()) {
    Serving& serving = serving_[object.id];
    const std::uint64_t host = gateway_.loader().serving_host(object.id);
    if (host != serving.host && host != 0) {
      if (serving.host != 0)
        report(Severity::kInfo, "object " + object.name + " is now served by host '" + host_name(host) + "'");
      serving = {host, serving.host == 0 ? 0 : now_ns, object.regions_received};
    }
    if (serving.since_ns == 0 || object.regions_received == serving.regions_before) continue;
    report(Severity::kInfo, "records of object " + object.name + " arrive again, " +
                                std::to_string((now_ns - serving.since_ns) / kMs) + " ms after the change of host");
    serving.since_ns = 0;
  }
}

std::optional<Membership::ClockRequest> Membership::clock_request(std::int64_t now_ns) {
  const std::uint64_t reference = clock_.reference();
  if (reference == 0 || reference == self_.participant || !clock_request_.due(now_ns)) return std::nullopt;
  if (++clock_requests_ == kFastClockRequests) clock_request_.set_period(kClockNs);
  const session::RosterEntry* const entry = roster_.find(reference);
  return ClockRequest{clock_.request(now_ns), entry != nullptr && entry->role == session::Role::kHost};
}

session::RosterEntry Membership::roster_entry(bool leaving, std::int64_t now_ns) {
  session::RosterEntry entry;
  entry.origin = self_;
  entry.role = session::Role::kHrtc;
  entry.name = settings_.name;
  entry.session = settings_.session;
  entry.served_users = user_table_.list();
  entry.heartbeat = ++heartbeats_;
  entry.leaving = leaving;
  entry.stops = stops_;
  session::put_time(clock_, is_force_on(now_ns), now_ns, entry);
  return entry;
}

std::array<std::uint64_t, kMaxProbes> Membership::user_ids() const {
  std::array<std::uint64_t, kMaxProbes> ids{};
  for (const auto& [probe, user] : users_) ids[probe] = user.id;
  return ids;
}

const std::string& Membership::name_at(std::uint32_t probe) const {
  static const std::string kNobody = "nobody";
  const auto user = users_.find(probe);
  return user == users_.end() ? kNobody : user->second.name;
}

}  // namespace tactus::hrtc_service
