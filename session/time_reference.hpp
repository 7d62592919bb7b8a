/// Election of the participant whose clock is session time, from the roster. Neither wall clocks nor machine identities
/// decide.
///
///     nobody claims    a host or HRTC that finds no other within 1 s of its start becomes the reference and begins a
///                      session
///     one claims       everyone follows it, also those that join later
///     it leaves        of its followers, the one with the smallest id continues the same time
///     two claim        the reference of the younger session yields to that of the older, and its followers follow
///
/// A claim is a roster entry that names its own participant as `reference`. Session time begins at 0, so the session
/// with the larger time is the older one. A reference yields only while no HRTC that follows it has a force on, and
/// each clock delays its step while its own program has a force on (SessionClock::set_force_on). So session time never
/// steps during a contact. Sessions that differ by no more than a clock can slew, as after a short partition, merge at
/// once.
/// Compare the bully algorithm (Garcia-Molina 1982); here age decides before the id.
///
/// No clock, socket or thread; one thread at a time.
#pragma once

#include <cstdint>

#include "session/clock.hpp"
#include "session/roster.hpp"

namespace tactus::session {

/// A program that has found no other for this long after its start is the first.
inline constexpr std::int64_t kReferenceSettleNs = 1'000'000'000;

struct TimeReference {
  std::uint64_t participant = 0;  ///< 0: none yet
  std::uint64_t incarnation = 0;
};
/// `role` and `force_on` are this program's. Hosts and HRTCs can be the reference.
[[nodiscard]] TimeReference time_reference(const Roster& roster, const Origin& self, Role role,
                                           const SessionClock& clock, bool force_on, std::int64_t local_now_ns);

/// Elects the reference and steers this program's clock to it; call it every few milliseconds. Also sets in the roster
/// how long this program has been in the session.
void keep_time(Roster& roster, const Origin& self, Role role, bool force_on, std::int64_t local_now_ns,
               SessionClock& clock);

/// Fills in the fields of a roster entry about time and force.
void put_time(const SessionClock& clock, bool force_on, std::int64_t local_now_ns, RosterEntry& entry);

}  // namespace tactus::session
