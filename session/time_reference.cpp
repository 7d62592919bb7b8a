#include "session/time_reference.hpp"

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <tuple>

namespace tactus::session {
namespace {

/// Sessions whose ages differ by at most this count as equally old. Then the participant that joined first decides.
constexpr std::int64_t kSameAgeNs = 1'000'000'000;

/// A participant that is a reference.
struct Reference {
  TimeReference id;
  std::int64_t session_ns = 0;  // its session time now
  std::int64_t joined_ns = 0;   // session time at which it joined
};

bool can_be_reference(Role role) noexcept { return role == Role::kHost || role == Role::kHrtc; }

bool outranks(const Reference& a, const Reference& b) noexcept {
  const std::int64_t older_ns = a.session_ns - b.session_ns;
  if (std::abs(older_ns) > kSameAgeNs) return older_ns > 0;
  return std::tie(a.joined_ns, a.id.participant) < std::tie(b.joined_ns, b.id.participant);
}

std::optional<Reference> reference_of(const Roster& roster, const RosterEntry& entry, const SessionClock& clock,
                                      std::int64_t local_now_ns) {
  if (!can_be_reference(entry.role) || entry.reference != entry.origin.participant) return std::nullopt;
  if (!clock.may_follow(entry.session_time_ns, local_now_ns)) return std::nullopt;
  const std::int64_t age_ns = local_now_ns - roster.received_ns(entry.origin.participant);
  return Reference{
      {entry.origin.participant, entry.origin.incarnation}, entry.session_time_ns + age_ns, entry.joined_ns};
}

/// Returns the highest-ranking reference other than this program; none if the roster has no reference.
std::optional<Reference> best_reference(const Roster& roster, const SessionClock& clock, std::int64_t local_now_ns) {
  std::optional<Reference> best;
  roster.for_each([&](const RosterEntry& entry) {
    const std::optional<Reference> reference = reference_of(roster, entry, clock, local_now_ns);
    if (reference && (!best || outranks(*reference, *best))) best = reference;
  });
  return best;
}

bool is_force_on_with(const Roster& roster, std::uint64_t reference) {
  bool on = false;
  roster.for_each([&](const RosterEntry& entry) { on = on || (entry.force_on && entry.reference == reference); });
  return on;
}

/// Returns the successor of a reference that has left: of the hosts and HRTCs that followed a reference, the one with
/// the smallest id. If none did, the smallest id of all hosts and HRTCs.
TimeReference successor(const Roster& roster, const Origin& self, Role role, const SessionClock& clock,
                        std::int64_t local_now_ns) {
  struct Candidate {
    bool follows;
    TimeReference id;
  };
  std::optional<Candidate> first;
  const auto consider = [&](bool follows, const Origin& origin) {
    const bool is_better =
        !first || follows != first->follows ? !first || follows : origin.participant < first->id.participant;
    if (is_better) first = Candidate{follows, {origin.participant, origin.incarnation}};
  };
  if (can_be_reference(role) && (clock.synchronised() || local_now_ns - clock.began_ns() >= kReferenceSettleNs))
    consider(clock.synchronised() && !clock.waits_for_force_off(), self);
  roster.for_each([&](const RosterEntry& entry) {
    if (can_be_reference(entry.role)) consider(entry.reference != 0, entry.origin);
  });
  return first ? first->id : TimeReference{};
}

}  // namespace

TimeReference time_reference(const Roster& roster, const Origin& self, Role role, const SessionClock& clock,
                             bool force_on, std::int64_t local_now_ns) {
  const std::optional<Reference> best = best_reference(roster, clock, local_now_ns);
  if (clock.answers_requests()) {
    const TimeReference own{self.participant, self.incarnation};
    if (!best) return own;
    const std::int64_t session_ns = clock.map().session_time(local_now_ns);
    if (!outranks(*best, {own, session_ns, clock.joined_ns()})) return own;
    const bool is_far = std::abs(best->session_ns - session_ns) > clock.settings().max_slewed_ns;
    const bool waits = is_far && (force_on || is_force_on_with(roster, self.participant));
    return waits ? own : best->id;
  }
  // A follower does not change its reference while that participant is a reference. If a session has two references,
  // the two decide between themselves which of them remains.
  const RosterEntry* const current = roster.find(clock.reference());
  if (current != nullptr && reference_of(roster, *current, clock, local_now_ns))
    return {current->origin.participant, current->origin.incarnation};
  return best ? best->id : successor(roster, self, role, clock, local_now_ns);
}

void update_session_clock(Roster& roster, const Origin& self, Role role, bool force_on, std::int64_t local_now_ns,
                          SessionClock& clock) {
  clock.set_force_on(force_on);
  const TimeReference reference = time_reference(roster, self, role, clock, force_on, local_now_ns);
  clock.set_reference(reference.participant, reference.incarnation, local_now_ns);
  roster.set_own_presence(clock.map().session_time(local_now_ns), clock.joined_ns());
}

void put_time(const SessionClock& clock, bool force_on, std::int64_t local_now_ns, RosterEntry& entry) {
  const bool follows =
      clock.synchronised() && !clock.waits_for_force_off();  // otherwise this program must not become the reference
  entry.reference = follows ? clock.reference() : 0;
  entry.session_time_ns = follows ? std::max<std::int64_t>(0, clock.map().session_time(local_now_ns)) : 0;
  entry.joined_ns = std::max<std::int64_t>(0, clock.joined_ns());
  entry.force_on = force_on;
}

}  // namespace tactus::session
