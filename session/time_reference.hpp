/// Elects the participant whose clock is session time, from the roster. Neither wall clocks nor machine identities
/// decide.
///
///     no reference             of the hosts and HRTCs, the one with the smallest id becomes the reference 1 s after
///                              its start, and begins a session
///     one reference            all participants follow it, also those that join later
///     the reference leaves     of its followers, the one with the smallest id continues the same time
///     two references           the reference of the younger session, and its followers, follow that of the older one
///
/// A reference is a participant whose roster entry names itself as `reference`. Session time begins at 0, so the
/// session with the larger time is the older one. A reference begins to follow another one only while neither it nor an
/// HRTC among its followers has a force on. Each clock delays its step while its own program has a force on
/// (SessionClock::set_force_on). So session time never steps during a contact. If the times of two sessions differ so
/// little that clocks may slew (ClockSettings::max_slewed_ns), for instance after a short network partition, the
/// sessions merge at once.
///
/// Compare the bully algorithm (Garcia-Molina 1982), in which the id decides. Here the age of the session decides. For
/// ages within 1 s of each other, the earlier joining decides, then the smaller id.
///
/// No clock, socket or thread; one thread at a time.
#pragma once

#include <cstdint>

#include "session/clock.hpp"
#include "session/roster.hpp"

namespace tactus::session {

/// Time after its start for which a program looks for another one before it begins a session.
inline constexpr std::int64_t kReferenceSettleNs = 1'000'000'000;

/// The participant whose clock is session time.
struct TimeReference {
  std::uint64_t participant = 0;  ///< 0: none yet
  std::uint64_t incarnation = 0;
};
/// Returns the reference that this program has to follow. `role` and `force_on` describe this program. Only hosts and
/// HRTCs can be the reference.
[[nodiscard]] TimeReference time_reference(const Roster& roster, const Origin& self, Role role,
                                           const SessionClock& clock, bool force_on, std::int64_t local_now_ns);

/// Elects the reference and makes this program's clock follow it. Also calls Roster::set_own_presence. Call it every
/// few milliseconds.
void update_session_clock(Roster& roster, const Origin& self, Role role, bool force_on, std::int64_t local_now_ns,
                          SessionClock& clock);

/// Fills those fields of a roster entry that state time and force.
void put_time(const SessionClock& clock, bool force_on, std::int64_t local_now_ns, RosterEntry& entry);

}  // namespace tactus::session
