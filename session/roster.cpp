#include "session/roster.hpp"

#include <xxhash.h>

#include <algorithm>
#include <stdexcept>

namespace tactus::session {
namespace {

/// A rival is another program with the same name. It counts as alive after so many accepted heartbeats, not counting
/// the first one. Fewer may be delayed entries of a program that has ended.
constexpr std::uint32_t kMinRivalHeartbeats = 2;
constexpr std::size_t kMaxRivals = 4;
constexpr std::size_t kMaxRefused = 256;

bool same_users(const RosterEntry& a, const RosterEntry& b) {
  return a.requested_hrtc == b.requested_hrtc && a.users == b.users &&
         std::equal(a.served_users.begin(), a.served_users.end(), b.served_users.begin(), b.served_users.end(),
                    [](const UserProbe& x, const UserProbe& y) { return x.user == y.user && x.probe == y.probe; });
}

/// Time since a program joined the session; -1: it has not joined.
std::int64_t presence_ns(const RosterEntry& entry) noexcept {
  return entry.joined_ns == kNotJoined ? -1 : entry.session_time_ns - entry.joined_ns;
}

/// Whether the program of `one` has to leave because that of `other` has the same name. The program that joined later
/// leaves. If both joined within a second, the one with the larger incarnation leaves. Both programs must apply the
/// same rule.
bool has_to_leave(const RosterEntry& one, const RosterEntry& other) noexcept {
  constexpr std::int64_t kSameNs = 1'000'000'000;
  const std::int64_t difference_ns = presence_ns(one) - presence_ns(other);
  if (difference_ns > kSameNs || difference_ns < -kSameNs) return difference_ns < 0;
  return one.origin.incarnation > other.origin.incarnation;
}

}  // namespace

std::string text(const RosterEntry& entry) {
  const std::string role = entry.role == Role::kHrtc ? "HRTC" : role_name(entry.role);
  return role + " '" + entry.name + "'";
}

Severity severity(const RosterEvent& event) noexcept {
  const bool is_problem = event.change == RosterChange::kWrongVersion || event.change == RosterChange::kNameConflict ||
                          event.change == RosterChange::kFull;
  return is_problem ? Severity::kWarning : Severity::kInfo;
}

std::string text(const RosterEvent& event) {
  const std::string who = text(event.entry);
  switch (event.change) {
    case RosterChange::kJoined:
      return who + " joined";
    case RosterChange::kRestarted:
      return who + " restarted";
    case RosterChange::kChanged:
      return who + " changed its users";
    case RosterChange::kLate:
      return who + " has sent no heartbeat for " + std::to_string(event.other) + " ms";
    case RosterChange::kRecovered:
      return who + " sends heartbeats again";
    case RosterChange::kLeft:
      return who + " left";
    case RosterChange::kGone:
      return who + " is silent, presumed failed";
    case RosterChange::kWrongVersion:
      return who + " refused: found protocol version " + std::to_string(event.other) + ", expected " +
             std::to_string(kProtocolVersion);
    case RosterChange::kNameConflict:
      return who + " runs twice: incarnations " + std::to_string(event.entry.origin.incarnation) + " and " +
             std::to_string(event.other) + " both send heartbeats under this name; the one that joined later leaves";
    case RosterChange::kFull:
      return who + " refused: the session has " + std::to_string(kMaxParticipants) + " participants already";
  }
  return who;
}

std::string name_taken_text(const std::string& name, const std::string& session) {
  return "another program named '" + name + "' is already in session '" + session +
         "'; this program ends; start it with another --name; if it has --keys, it needs keys of that name";
}

Roster::Roster(const Origin& self, const RosterSettings& settings) : self_{self}, settings_{settings} {
  own_.entry.origin = self;
  own_.present = true;
}

std::vector<RosterEvent> Roster::on_entry(const RosterEntry& entry, std::int64_t now_ns) {
  std::vector<RosterEvent> events;
  if (entry.origin.session != self_.session) return events;
  const auto member = members_.find(entry.origin.participant);
  if (entry.origin.participant == self_.participant) {
    on_own_name(entry, now_ns, events);
  } else if (entry.protocol != kProtocolVersion) {
    refuse(entry, RosterChange::kWrongVersion, entry.protocol, events);
  } else if (member == members_.end()) {
    on_new_name(entry, now_ns, events);
  } else if (entry.origin.incarnation < member->second.entry.origin.incarnation) {
    on_older_incarnation(member->second, entry, now_ns, events);
  } else {
    on_newest_incarnation(member->second, entry, now_ns, events);
  }
  return events;
}

/// Applies an entry with the name of this program: its own, or that of a rival.
void Roster::on_own_name(const RosterEntry& entry, std::int64_t now_ns, std::vector<RosterEvent>& events) {
  own_.entry.name = entry.name;
  own_.entry.role = entry.role;
  if (entry.origin.incarnation != self_.incarnation) (void)track_rival(own_, entry, now_ns, events);
}

/// Adds an event for the first refused entry of a program.
void Roster::refuse(const RosterEntry& entry, RosterChange change, std::uint64_t other,
                    std::vector<RosterEvent>& events) {
  if (refused_.size() == kMaxRefused) refused_.clear();
  const auto program = std::make_pair(entry.origin.participant, entry.origin.incarnation);
  if (refused_.emplace(program, entry.protocol).second) events.push_back({change, entry, other});
}

void Roster::on_new_name(const RosterEntry& entry, std::int64_t now_ns, std::vector<RosterEvent>& events) {
  if (entry.leaving) return;
  if (members_.size() == kMaxParticipants) forget_absent();
  if (members_.size() == kMaxParticipants) return refuse(entry, RosterChange::kFull, 0, events);
  Member& member = members_[entry.origin.participant];
  member.entry = entry;
  (void)member.heartbeats.admit(entry.heartbeat, now_ns);
  member.present = true;
  member.received_ns = now_ns;
  member.missed_ns = 0;
  events.push_back({RosterChange::kJoined, entry, 0});
}

/// Applies an entry of an incarnation that is older than the participant's newest one.
void Roster::on_older_incarnation(Member& member, const RosterEntry& entry, std::int64_t now_ns,
                                  std::vector<RosterEvent>& events) const {
  const bool alive = track_rival(member, entry, now_ns, events);
  if (member.present || !alive) return;
  // The newer incarnation has ended, so the older one is the participant again.
  const SequenceWindow heartbeats = member.rivals.at(entry.origin.incarnation).heartbeats;
  member = Member{};
  member.entry = entry;
  member.heartbeats = heartbeats;
  member.present = true;
  member.received_ns = now_ns;
  member.missed_ns = 0;
  events.push_back({RosterChange::kJoined, entry, 0});
}

/// Applies an entry of the participant's newest incarnation, or of one that is newer still.
void Roster::on_newest_incarnation(Member& member, const RosterEntry& entry, std::int64_t now_ns,
                                   std::vector<RosterEvent>& events) {
  const auto add_event = [&](RosterChange change) { events.push_back({change, entry, 0}); };
  const std::uint64_t before = member.entry.origin.incarnation;
  const bool is_same = entry.origin.incarnation == before;
  if (is_same && member.left) return;
  SequenceWindow heartbeats = is_same ? member.heartbeats : SequenceWindow{kHeartbeatNumbers};
  const Admission admission = heartbeats.admit(entry.heartbeat, now_ns);
  if (!accepted(admission)) {
    member.heartbeats = heartbeats;
    implausible_ += admission == Admission::kImplausible ? 1 : 0;
    return;
  }
  if (entry.leaving) {
    if (member.present) add_event(RosterChange::kLeft);
    member = Member{};
    member.entry = entry;
    member.heartbeats = heartbeats;
    member.left = true;
    member.received_ns = now_ns;
    member.missed_ns = 0;
    return;
  }
  if (!member.present) {
    add_event(RosterChange::kJoined);
  } else if (!is_same) {
    add_event(RosterChange::kRestarted);
    if (member.rivals.size() < kMaxRivals) member.rivals[before] = {member.heartbeats, 0, false, now_ns};
  } else {
    if (member.late) add_event(RosterChange::kRecovered);
    if (!same_users(entry, member.entry)) add_event(RosterChange::kChanged);
  }
  member.present = true;
  member.left = member.late = false;
  member.entry = entry;
  member.heartbeats = heartbeats;
  member.received_ns = now_ns;
  member.missed_ns = 0;
}

/// Counts the heartbeats of a rival, and adds an event for a new name conflict. Returns true when enough heartbeats
/// have arrived to show that the rival is alive.
bool Roster::track_rival(Member& member, const RosterEntry& entry, std::int64_t now_ns,
                         std::vector<RosterEvent>& events) const {
  const std::uint64_t incarnation = entry.origin.incarnation;
  if (member.rivals.count(incarnation) == 0) {
    if (member.rivals.size() < kMaxRivals) {
      Rival& added = member.rivals[incarnation];
      (void)added.heartbeats.admit(entry.heartbeat, now_ns);
      added.received_ns = now_ns;
    }
    return false;
  }
  Rival& rival = member.rivals[incarnation];
  if (entry.leaving || !accepted(rival.heartbeats.admit(entry.heartbeat, now_ns))) return false;
  rival.received_ns = now_ns;
  if (++rival.accepted < kMinRivalHeartbeats) return false;
  if (member.present && !rival.reported) {
    rival.reported = true;
    events.push_back({RosterChange::kNameConflict, member.entry, incarnation, has_to_leave(member.entry, entry)});
  }
  return true;
}

std::vector<RosterEvent> Roster::tick(std::int64_t now_ns) {
  std::vector<RosterEvent> events;
  add_missed_time(now_ns);
  forget_rivals(own_, now_ns);
  for (auto at = members_.begin(); at != members_.end();) {
    Member& member = at->second;
    const std::int64_t silent = now_ns - member.received_ns - member.missed_ns;
    forget_rivals(member, now_ns);
    if (!member.present && silent >= settings_.forget_ns && member.rivals.empty()) {
      at = members_.erase(at);
      continue;
    }
    ++at;
    if (!member.present) continue;
    if (silent >= settings_.gone_ns) {
      member.present = member.late = false;
      member.rivals.clear();
      events.push_back({RosterChange::kGone, member.entry, 0});
    } else if (silent >= settings_.late_ns && !member.late) {
      member.late = true;
      events.push_back({RosterChange::kLate, member.entry, static_cast<std::uint64_t>(settings_.late_ns / 1'000'000)});
    }
  }
  return events;
}

/// If this program has not run, for example because it was suspended, others may have sent heartbeats that it has not
/// processed yet. So this time does not count as their silence.
void Roster::add_missed_time(std::int64_t now_ns) {
  const std::int64_t missed_ns = ticked_ns_ ? now_ns - *ticked_ns_ - settings_.max_tick_ns : 0;
  ticked_ns_ = now_ns;
  if (missed_ns <= 0) return;
  for (auto& [id, member] : members_) {
    member.missed_ns += missed_ns;
    for (auto& [incarnation, rival] : member.rivals) rival.received_ns += missed_ns;
  }
  for (auto& [incarnation, rival] : own_.rivals) rival.received_ns += missed_ns;
}

/// Deletes silent rivals, so that new ones can be stored.
void Roster::forget_rivals(Member& member, std::int64_t now_ns) const {
  for (auto rival = member.rivals.begin(); rival != member.rivals.end();)
    rival = now_ns - rival->second.received_ns >= settings_.gone_ns ? member.rivals.erase(rival) : std::next(rival);
}

void Roster::forget_absent() {
  for (auto at = members_.begin(); at != members_.end();) at = at->second.present ? std::next(at) : members_.erase(at);
}

const RosterEntry* Roster::find(std::uint64_t participant) const {
  const auto at = members_.find(participant);
  return at == members_.end() || !at->second.present ? nullptr : &at->second.entry;
}

std::vector<RosterEntry> Roster::entries() const {
  std::vector<RosterEntry> all;
  for_each([&](const RosterEntry& entry) { all.push_back(entry); });
  return all;
}

std::int64_t Roster::received_ns(std::uint64_t participant) const {
  const auto at = members_.find(participant);
  return at == members_.end() || !at->second.present ? 0 : at->second.received_ns;
}

bool Roster::is_late(std::uint64_t participant) const {
  const auto at = members_.find(participant);
  return at != members_.end() && at->second.present && at->second.late;
}

bool Roster::has_left(std::uint64_t participant) const {
  const auto at = members_.find(participant);
  return at != members_.end() && at->second.left;
}

std::uint64_t scene_hash(const Roster& roster, const Origin& self, Role role) {
  std::vector<std::pair<std::uint64_t, std::uint64_t>> there;
  const auto add = [&](Role of, const Origin& origin) {
    if (of == Role::kHost || of == Role::kHrtc) there.emplace_back(origin.participant, origin.incarnation);
  };
  add(role, self);
  roster.for_each([&](const RosterEntry& entry) { add(entry.role, entry.origin); });
  std::sort(there.begin(), there.end());
  return XXH3_64bits(there.data(), there.size() * sizeof there[0]);
}

UserTable::UserTable(std::size_t capacity, std::span<const std::uint64_t> earlier)
    : users_(capacity), earlier_{earlier.begin(), earlier.end()} {
  earlier_.resize(capacity);
  if (capacity > kMaxUsers) {
    throw std::invalid_argument{"user table: found " + std::to_string(capacity) + ", expected at most " +
                                std::to_string(kMaxUsers)};
  }
}

std::optional<std::uint32_t> UserTable::grant(const std::string& user) {
  if (user.empty()) return std::nullopt;
  const auto free_number_of = [&](std::uint64_t owner) {
    for (std::size_t i = 0; i < users_.size(); ++i)
      if (users_[i].empty() && earlier_[i] == owner) return users_.begin() + static_cast<std::ptrdiff_t>(i);
    return users_.end();
  };
  auto at = std::find(users_.begin(), users_.end(), user);
  if (at == users_.end()) at = free_number_of(id_of(user));
  if (at == users_.end()) at = free_number_of(0);
  if (at == users_.end()) at = std::find(users_.begin(), users_.end(), std::string{});
  if (at == users_.end()) return std::nullopt;
  *at = user;
  const auto number = static_cast<std::uint32_t>(at - users_.begin());
  earlier_[number] = 0;
  return number;
}

bool UserTable::release(const std::string& user) {
  const auto at = std::find(users_.begin(), users_.end(), user);
  if (user.empty() || at == users_.end()) return false;
  at->clear();
  return true;
}

std::vector<UserProbe> UserTable::list() const {
  std::vector<UserProbe> served_users;
  for (std::size_t i = 0; i < users_.size(); ++i) {
    if (!users_[i].empty()) served_users.push_back({users_[i], static_cast<std::uint32_t>(i)});
  }
  return served_users;
}

}  // namespace tactus::session
