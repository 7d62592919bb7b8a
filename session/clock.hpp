/// The session clock: estimates the session time of the time reference, and follows it by slewing.
///
///     requester  t0 ----request---->  t1   reference
///     requester  t3 <---answer------  t2             offset = ((t1 - t0) + (t2 - t3)) / 2
///
/// The error of this offset is at most half of the round trip, (t3 - t0) - (t2 - t1).
/// t0 and t3 are times of the requester's monotonic clock. t1 and t2 are session time of the reference, which is its
/// monotonic clock plus a constant. Session time begins at 0 with the first program and continues when another
/// participant becomes the reference. So session time is also the age of the session (session/time_reference.hpp).
///
/// Of the newest answers, the clock uses the one with the smallest error bound. The bound of an answer grows with its
/// age, because two clocks drift apart. The first answer sets the clock. After that the clock runs slightly faster or
/// slower until it agrees with the reference. It steps only when the error is above `step_ns` plus the error bound:
/// then two sessions that began separately have merged. While the caller reports that a force is on, the clock only
/// slews, because coupled objects and simulated hands move by session time. Programs that start together, whose users
/// touch before there is a reference, differ by up to some seconds. If the error is above `max_slewed_ns` plus the
/// error bound while a force is on, the clock continues as it is, and its bound states the error.
///
/// Local monotonic nanoseconds are arguments; no clock inside. One thread; a ClockMap may be copied to other threads.
/// Source: RFC 5905, section 8 (four-stamp exchange) and its clock filter (lowest delay in a window).
#pragma once

#include <array>
#include <cstdint>
#include <deque>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

struct ClockSettings {
  std::size_t window = 16;             ///< number of newest answers that are compared
  double max_slew = 0.05;              ///< max difference between the rates of session time and local clock, s/s
  std::int64_t step_ns = 100'000'000;  ///< an error above this plus the error bound causes a step
  std::int64_t max_slewed_ns = 2'000'000'000;  ///< max error that the clock removes by slewing while a force is on
  double drift = 200e-6;                       ///< max drift between two clocks, s/s
  std::int64_t max_rtt_ns = 1'000'000'000;     ///< answers with a longer round trip are ignored
};

/// Maps local time to session time. Session time slews until `slew_until_ns`; after that it runs at the rate of the
/// local clock.
struct ClockMap {
  std::int64_t local_ns = 0;
  std::int64_t session_ns = 0;
  double slew = 0;                 ///< s/s, rate of session time minus rate of local time
  std::int64_t slew_until_ns = 0;  ///< local time
  std::int64_t bound_ns = 0;       ///< error bound at local_ns, without the offset that the slewing still removes
  double drift = 0;                ///< growth of the bound, s/s

  /// Session time at a local time not before `local_ns`.
  [[nodiscard]] std::int64_t session_time(std::int64_t at_local_ns) const noexcept;
  /// Max error of session time. It is 0 for the reference itself, and kClockUnknown until an answer has set the clock,
  /// or the clock slews to it (SessionClock). When the reference changes, the error against the
  /// previous reference is returned until the new one answers, or kClockUnknown if this program was the reference.
  [[nodiscard]] std::int64_t error_bound(std::int64_t at_local_ns) const noexcept;
};

/// Error bound of a clock that has received no answer yet.
inline constexpr std::int64_t kClockUnknown = INT64_C(1) << 60;
/// Latest session time to which a reference can set a clock. A roster entry can state twice that time. Otherwise a
/// reference could set the clocks of all programs so that none of them could send roster entries.
inline constexpr std::int64_t kMaxReferenceNs = INT64_C(1) << 59;

class SessionClock {
 public:
  /// Begins with session time 0 at `local_now_ns`; the first answer of a reference sets another, unless a force is on.
  SessionClock(const Origin& self, const ClockSettings& settings, std::int64_t local_now_ns);

  /// Sets the reference that time_reference has elected. If it is this program, the clock runs freely. `participant` 0:
  /// there is no reference.
  void set_reference(std::uint64_t participant, std::uint64_t incarnation, std::int64_t local_now_ns);
  [[nodiscard]] std::uint64_t reference() const noexcept { return reference_; }
  /// Sets whether a force of this program is on; meanwhile the clock does not step.
  void set_force_on(bool on) noexcept { force_on_ = on; }

  /// Returns a request to publish now. Call it periodically while another participant is the reference.
  [[nodiscard]] ClockSample request(std::int64_t local_now_ns);
  /// Whether this program answers requests. Only the reference does, because other clocks still slew.
  [[nodiscard]] bool answers_requests() const noexcept { return reference_ != 0 && reference_ == self_.participant; }
  /// Returns the answer to publish at once. `local_received_ns`: arrival of the request.
  [[nodiscard]] ClockSample answer(const ClockSample& request, std::int64_t local_received_ns,
                                   std::int64_t local_now_ns) const;
  /// Applies an answer that arrived at `local_now_ns`. Returns false for an answer that is not from the reference,
  /// matches no request of this clock, is repeated, overtaken, impossible or implausible (session/sequence_window.hpp),
  /// or took longer than `max_rtt_ns`.
  bool on_answer(const ClockSample& answer, std::int64_t local_now_ns);

  /// Whether session time is valid: this program is the reference, or has received an answer of the reference.
  [[nodiscard]] bool synchronised() const noexcept { return synchronised_; }
  /// Whether the clock has to be set or to step, but waits because a force is on.
  [[nodiscard]] bool waits_for_force_off() const noexcept { return waits_for_force_off_; }
  [[nodiscard]] const ClockMap& map() const noexcept { return map_; }
  /// Number of answers dropped because their time was outside its window.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }
  /// Local time of construction.
  [[nodiscard]] std::int64_t began_ns() const noexcept { return began_ns_; }
  /// Session time at which this program joined; kNotJoined until it is synchronised. A step changes this time, because
  /// the program has then joined another session.
  [[nodiscard]] std::int64_t joined_ns() const noexcept { return joined_ns_; }
  [[nodiscard]] const ClockSettings& settings() const noexcept { return settings_; }
  /// Returns whether session time may follow a reference with this time. Near its end, it may not step: the limit is
  /// kMaxReferenceNs, and larger for a program that has no session time yet, so that it can join one near this limit.
  [[nodiscard]] bool may_follow(std::int64_t session_ns, std::int64_t local_now_ns) const noexcept {
    const std::int64_t limit = synchronised_ ? kMaxReferenceNs : kMaxReferenceNs / 2 * 3;
    return session_ns <= limit || session_ns - map_.session_time(local_now_ns) <= settings_.max_slewed_ns;
  }

 private:
  /// The offset that one answer gives.
  struct Measurement {
    std::int64_t local_ns;
    std::int64_t offset_ns;  // session minus local
    std::int64_t bound_ns;
  };
  void steer(std::int64_t local_now_ns);

  Origin self_;
  ClockSettings settings_;
  std::int64_t began_ns_;
  std::uint64_t reference_ = 0;
  std::uint64_t reference_incarnation_ = 0;
  bool synchronised_ = false;
  bool force_on_ = false, waits_for_force_off_ = false;
  std::int64_t joined_ns_ = kNotJoined;
  std::uint32_t sequence_ = 0;
  std::array<std::int64_t, 16> requested_ns_{};  // local times of the newest requests, by sequence
  std::uint32_t answered_ = 0;                   // newest request that was answered
  std::uint64_t implausible_ = 0;
  TimeWindow times_;  // session times in the reference's answers
  std::deque<Measurement> window_;
  ClockMap map_;
};

}  // namespace tactus::session
