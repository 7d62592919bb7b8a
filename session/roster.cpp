#include "session/roster.hpp"

#include <xxhash.h>

#include <algorithm>
#include <stdexcept>

namespace tactus::session {
namespace {

/// Heartbeats after which an older incarnation counts as alive, not as late samples.
constexpr std::uint32_t kBeatsOfALiveRival = 2;
constexpr std::size_t kMaxRivals = 4;
constexpr std::size_t kMaxRefused = 256;

const char* name_of(Role role) {
  switch (role) {
    case Role::kHost:
      return "host";
    case Role::kHrtc:
      return "HRTC";
    case Role::kClient:
      return "client";
    case Role::kViewer:
      return "viewer";
  }
  return "participant";
}

bool same_users(const RosterEntry& a, const RosterEntry& b) {
  return a.controller == b.controller && a.users == b.users &&
         std::equal(a.slots.begin(), a.slots.end(), b.slots.begin(), b.slots.end(),
                    [](const UserSlot& x, const UserSlot& y) { return x.user == y.user && x.slot == y.slot; });
}

/// How long a program has been in the session.
std::int64_t presence_ns(const RosterEntry& entry) noexcept {
  return entry.joined_ns == kNotJoined ? -1 : entry.session_time_ns - entry.joined_ns;
}

/// Of two programs with one name, the one that joined later yields. If they joined at about the same time, the larger
/// incarnation yields: any rule will do on which both agree.
bool yields(const RosterEntry& one, const RosterEntry& other) noexcept {
  constexpr std::int64_t kSameNs = 1'000'000'000;
  const std::int64_t longer_ns = presence_ns(one) - presence_ns(other);
  if (longer_ns > kSameNs || longer_ns < -kSameNs) return longer_ns < 0;
  return one.origin.incarnation > other.origin.incarnation;
}

}  // namespace

std::string text(const RosterEntry& entry) { return std::string{name_of(entry.role)} + " '" + entry.name + "'"; }

std::string text(const RosterEvent& event) {
  const std::string who = text(event.entry);
  switch (event.change) {
    case RosterChange::kJoined:
      return who + " joined";
    case RosterChange::kRestarted:
      return who + " is back as a new program";
    case RosterChange::kChanged:
      return who + " changed its users";
    case RosterChange::kLate:
      return who + " is late";
    case RosterChange::kBack:
      return who + " is in time again";
    case RosterChange::kLeft:
      return who + " left";
    case RosterChange::kGone:
      return who + " is gone without a word";
    case RosterChange::kWrongVersion:
      return who + " refused: it speaks protocol version " + std::to_string(event.other) + ", we speak version " +
             std::to_string(kProtocolVersion);
    case RosterChange::kNameConflict:
      return who + " is there twice: incarnations " + std::to_string(event.entry.origin.incarnation) + " and " +
             std::to_string(event.other) + " both beat under this name; give one of them another --name";
    case RosterChange::kFull:
      return who + " refused: the session has " + std::to_string(kMaxParticipants) + " participants already";
  }
  return who;
}

Roster::Roster(const Origin& self, const RosterSettings& settings) : self_{self}, settings_{settings} {
  own_.entry.origin = self;
  own_.here = true;
}

std::vector<RosterEvent> Roster::on_entry(const RosterEntry& entry, std::int64_t now_ns) {
  std::vector<RosterEvent> events;
  const auto tell = [&](RosterChange change) { events.push_back({change, entry, 0}); };
  if (entry.origin.session != self_.session) return events;
  const std::uint64_t id = entry.origin.participant;
  const std::uint64_t incarnation = entry.origin.incarnation;
  if (id == self_.participant) {
    own_.entry.name = entry.name;
    own_.entry.role = entry.role;
    if (incarnation != self_.incarnation) (void)watch_rival(own_, entry, now_ns, events);
    return events;
  }
  if (entry.protocol != kProtocolVersion) {
    if (refused_.size() == kMaxRefused) refused_.clear();
    const bool is_new = refused_.emplace(std::make_pair(id, incarnation), entry.protocol).second;
    if (is_new) events.push_back({RosterChange::kWrongVersion, entry, entry.protocol});
    return events;
  }

  auto at = known_.find(id);
  if (at == known_.end()) {
    if (entry.leaving) return events;
    if (known_.size() == kMaxParticipants) forget_absent();
    if (known_.size() == kMaxParticipants) {
      if (refused_.size() == kMaxRefused) refused_.clear();
      const bool is_new = refused_.emplace(std::make_pair(id, incarnation), entry.protocol).second;
      if (is_new) tell(RosterChange::kFull);
      return events;
    }
    at = known_.try_emplace(id).first;
    at->second.entry = entry;
    (void)at->second.heartbeats.admit(entry.heartbeat, now_ns);
    at->second.here = true;
    at->second.seen_ns = now_ns;
    tell(RosterChange::kJoined);
    return events;
  }

  Known& known = at->second;
  const std::uint64_t before = known.entry.origin.incarnation;
  if (incarnation < before) {
    const bool alive = watch_rival(known, entry, now_ns, events);
    if (!known.here && alive) {  // the newer program has yielded or died: the older one keeps the name
      const SequenceWindow heartbeats = known.rivals.at(incarnation).heartbeats;
      known = Known{};
      known.entry = entry;
      known.heartbeats = heartbeats;
      known.here = true;
      known.seen_ns = now_ns;
      tell(RosterChange::kJoined);
    }
    return events;
  }
  if (incarnation == before && known.left) return events;
  SequenceWindow heartbeats = incarnation == before ? known.heartbeats : SequenceWindow{kHeartbeatNumbers};
  const Admission admission = heartbeats.admit(entry.heartbeat, now_ns);
  if (!accepted(admission)) {
    known.heartbeats = heartbeats;
    implausible_ += admission == Admission::kImplausible ? 1 : 0;
    return events;
  }
  if (entry.leaving) {
    if (known.here) tell(RosterChange::kLeft);
    known = Known{};
    known.entry = entry;
    known.heartbeats = heartbeats;
    known.left = true;
    known.seen_ns = now_ns;
    return events;
  }
  if (!known.here) {
    tell(RosterChange::kJoined);
  } else if (incarnation > before) {
    tell(RosterChange::kRestarted);
    if (known.rivals.size() < kMaxRivals) known.rivals[before] = {known.heartbeats, 0, false, now_ns};
  } else {
    if (known.late) tell(RosterChange::kBack);
    if (!same_users(entry, known.entry)) tell(RosterChange::kChanged);
  }
  known.here = true;
  known.left = known.late = false;
  known.entry = entry;
  known.heartbeats = heartbeats;
  known.seen_ns = now_ns;
  return events;
}

/// True when the entry's program is alive: enough heartbeats have come since its first entry as a rival.
bool Roster::watch_rival(Known& known, const RosterEntry& entry, std::int64_t now_ns,
                         std::vector<RosterEvent>& events) const {
  const std::uint64_t incarnation = entry.origin.incarnation;
  if (known.rivals.count(incarnation) == 0) {
    if (known.rivals.size() < kMaxRivals) {
      Rival& added = known.rivals[incarnation];
      (void)added.heartbeats.admit(entry.heartbeat, now_ns);
      added.seen_ns = now_ns;
    }
    return false;
  }
  Rival& rival = known.rivals[incarnation];
  if (entry.leaving || !accepted(rival.heartbeats.admit(entry.heartbeat, now_ns))) return false;
  rival.seen_ns = now_ns;
  if (++rival.beats < kBeatsOfALiveRival) return false;
  if (known.here && !rival.reported) {
    rival.reported = true;
    events.push_back({RosterChange::kNameConflict, known.entry, incarnation, yields(known.entry, entry)});
  }
  return true;
}

std::vector<RosterEvent> Roster::tick(std::int64_t now_ns) {
  std::vector<RosterEvent> events;
  forget_rivals(own_, now_ns);
  for (auto at = known_.begin(); at != known_.end();) {
    Known& known = at->second;
    const std::int64_t silent = now_ns - known.seen_ns;
    forget_rivals(known, now_ns);
    if (!known.here && silent >= settings_.forget_ns && known.rivals.empty()) {
      at = known_.erase(at);
      continue;
    }
    ++at;
    if (!known.here) continue;
    if (silent >= settings_.gone_ns) {
      known.here = known.late = false;
      known.rivals.clear();
      events.push_back({RosterChange::kGone, known.entry, 0});
    } else if (silent >= settings_.late_ns && !known.late) {
      known.late = true;
      events.push_back({RosterChange::kLate, known.entry, 0});
    }
  }
  return events;
}

/// Makes room for new rivals.
void Roster::forget_rivals(Known& known, std::int64_t now_ns) const {
  for (auto rival = known.rivals.begin(); rival != known.rivals.end();)
    rival = now_ns - rival->second.seen_ns >= settings_.gone_ns ? known.rivals.erase(rival) : std::next(rival);
}

void Roster::forget_absent() {
  for (auto at = known_.begin(); at != known_.end();) at = at->second.here ? std::next(at) : known_.erase(at);
}

const RosterEntry* Roster::find(std::uint64_t participant) const {
  const auto at = known_.find(participant);
  return at == known_.end() || !at->second.here ? nullptr : &at->second.entry;
}

std::vector<RosterEntry> Roster::entries() const {
  std::vector<RosterEntry> all;
  for_each([&](const RosterEntry& entry) { all.push_back(entry); });
  return all;
}

std::int64_t Roster::seen_ns(std::uint64_t participant) const {
  const auto at = known_.find(participant);
  return at == known_.end() || !at->second.here ? 0 : at->second.seen_ns;
}

bool Roster::is_late(std::uint64_t participant) const {
  const auto at = known_.find(participant);
  return at != known_.end() && at->second.here && at->second.late;
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

UserSlots::UserSlots(std::size_t capacity) : users_(capacity) {
  if (capacity > kMaxSlots) {
    throw std::invalid_argument{"user slots: found " + std::to_string(capacity) + ", expected at most " +
                                std::to_string(kMaxSlots)};
  }
}

std::optional<std::uint32_t> UserSlots::grant(const std::string& user) {
  auto at = std::find(users_.begin(), users_.end(), user);
  if (user.empty() || at == users_.end()) at = std::find(users_.begin(), users_.end(), std::string{});
  if (user.empty() || at == users_.end()) return std::nullopt;
  *at = user;
  return static_cast<std::uint32_t>(at - users_.begin());
}

bool UserSlots::release(const std::string& user) {
  const auto at = std::find(users_.begin(), users_.end(), user);
  if (user.empty() || at == users_.end()) return false;
  at->clear();
  return true;
}

std::vector<UserSlot> UserSlots::list() const {
  std::vector<UserSlot> slots;
  for (std::size_t i = 0; i < users_.size(); ++i) {
    if (!users_[i].empty()) slots.push_back({users_[i], static_cast<std::uint32_t>(i)});
  }
  return slots;
}

}  // namespace tactus::session
