/// Whose clock the session goes by, elected from what the roster says; no wall clock and no identity of a machine
/// decides.
///
///     nobody claims    1 s after its start a host or HRTC that found no other becomes the reference: a session begins
///     one claims       everyone follows it, whoever comes later
///     it goes          of those who followed it, the one with the smallest id goes on with the same time
///     two claim        the reference of the younger session yields to that of the older, and its followers go along
///
/// A claim is a roster entry that names its own participant as `reference`. Session time begins at 0, so the older
/// session is the one whose time is further on. A reference yields only when no HRTC that follows it has a force on,
/// and each clock waits with its step for its own forces (SessionClock::set_force_on): so session time never steps
/// under a hand. Sessions that differ by no more than a clock steers away, as after a short partition, join at once.
///
/// No clock, socket or thread in it; one thread at a time.
#pragma once

#include <cstdint>

#include "session/clock.hpp"
#include "session/roster.hpp"

namespace tactus::session {

/// A program that has heard of nobody for so long after its start is the first.
inline constexpr std::int64_t kReferenceSettleNs = 1'000'000'000;

struct TimeReference {
  std::uint64_t participant = 0;  ///< 0: nobody yet
  std::uint64_t incarnation = 0;
};
/// `role` is this program's; hosts and HRTCs can be the reference. `force_on`: at this program.
[[nodiscard]] TimeReference time_reference(const Roster& roster, const Origin& self, Role role,
                                           const SessionClock& clock, bool force_on, std::int64_t local_now_ns);

/// Elects the reference and keeps this program's clock to it; to be called every few milliseconds. The roster learns
/// how long this program has been in the session.
void keep_time(Roster& roster, const Origin& self, Role role, bool force_on, std::int64_t local_now_ns,
               SessionClock& clock);

/// Fills in what a roster entry says of time and force.
void put_time(const SessionClock& clock, bool force_on, std::int64_t local_now_ns, RosterEntry& entry);

}  // namespace tactus::session
