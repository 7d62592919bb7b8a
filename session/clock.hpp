/// One time for the session: estimated against a reference participant, and steered without steps.
///
///     asker    t0 ----request---->  t1   reference
///     asker    t3 <---answer------  t2             offset = ((t1 - t0) + (t2 - t3)) / 2, right to (rtt / 2)
///
/// t0 and t3 are the asker's monotonic clock, t1 and t2 the reference's session time, which is its own monotonic clock
/// plus a constant. A session's time begins at 0 with the first program and goes on when another participant becomes
/// the reference, so it also says how old the session is (session/time_reference.hpp). The answer with the smallest
/// bound in a window counts; the bound of an old one grows by what two crystals may drift apart.
/// The first answer sets the clock; after that it runs a little faster or slower until it agrees. It steps only when
/// the error is above `step_ns` and proven: then two sessions have met that began apart. Neither the first setting nor
/// a step happens while the caller says that a force is on: forces between coupled objects, and what a hand does next,
/// follow from session time. Until then the clock goes on as it was, and its bound states the error.
///
/// No clock in it: local monotonic nanoseconds come as arguments. One thread; a ClockMap may be copied to others.
/// Source: RFC 5905, section 8 (four-stamp exchange) and its clock filter (lowest delay in a window).
#pragma once

#include <array>
#include <cstdint>
#include <deque>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

struct ClockSettings {
  std::size_t window = 16;             ///< answers that are compared
  double max_slew = 0.05;              ///< how much faster or slower than the local clock session time may run
  std::int64_t step_ns = 100'000'000;  ///< an error above this, and above what both bounds allow, is no drift: step
  double drift = 200e-6;               ///< how far two clocks may run apart, s/s
  std::int64_t max_rtt_ns = 1'000'000'000;  ///< answers that took longer are ignored
};

/// From local to session time, valid until replaced; a plain value. It is the slewing line up to `slew_until_ns` and
/// one to one after that.
struct ClockMap {
  std::int64_t local_ns = 0;
  std::int64_t session_ns = 0;
  double slew = 0;                 ///< session time gained per local time
  std::int64_t slew_until_ns = 0;  ///< local
  std::int64_t bound_ns = 0;       ///< at local_ns, of what session_time gives after the slewing
  double drift = 0;                ///< by which the bound grows

  /// Session time at a local time not before `local_ns`.
  [[nodiscard]] std::int64_t session_time(std::int64_t at_local_ns) const noexcept;
  /// How far that may be from the reference's; from the one before it, until a new one has answered.
  [[nodiscard]] std::int64_t bound(std::int64_t at_local_ns) const noexcept;
};

/// Bound of a clock that has received no answer yet.
inline constexpr std::int64_t kClockUnknown = INT64_C(1) << 60;

class SessionClock {
 public:
  /// Session time begins at 0 at `local_now_ns`, should nobody else be there.
  SessionClock(const Origin& self, const ClockSettings& settings, std::int64_t local_now_ns);

  /// Who is the reference now, see time_reference; this program itself makes the clock run on freely. 0: nobody yet.
  void set_reference(std::uint64_t participant, std::uint64_t incarnation, std::int64_t local_now_ns);
  [[nodiscard]] std::uint64_t reference() const noexcept { return reference_; }
  /// Whether a force is on at this program: then the clock does not step, but waits.
  void set_force_on(bool on) noexcept { force_on_ = on; }

  /// To publish now and then when the reference is another.
  [[nodiscard]] ClockSample request(std::int64_t local_now_ns);
  /// Whether requests for this program are to be answered: by the one who is the reference, and knows it. Any other's
  /// time is still being steered.
  [[nodiscard]] bool answers() const noexcept { return reference_ != 0 && reference_ == self_.participant; }
  /// To publish at once when such a request arrives; `local_received_ns` when it came.
  [[nodiscard]] ClockSample answer(const ClockSample& request, std::int64_t local_received_ns,
                                   std::int64_t local_now_ns) const;
  /// An answer arrived at `local_now_ns`. False when it is not of the reference, not to a request of this clock, a
  /// repetition, impossible or implausible (session/sequence_window.hpp).
  bool on_answer(const ClockSample& answer, std::int64_t local_now_ns);

  /// Whether session time means something: this is the reference, or has received its answer.
  [[nodiscard]] bool synchronised() const noexcept { return synchronised_; }
  /// The clock would have been set or stepped, but a force is on.
  [[nodiscard]] bool waits() const noexcept { return waits_; }
  [[nodiscard]] const ClockMap& map() const noexcept { return map_; }
  /// When it began, local.
  [[nodiscard]] std::int64_t began_ns() const noexcept { return began_ns_; }
  /// Session time since which this program has been in the session; kNotJoined until it is synchronised. A step
  /// begins anew: the program has joined another session's time.
  [[nodiscard]] std::int64_t joined_ns() const noexcept { return joined_ns_; }
  [[nodiscard]] const ClockSettings& settings() const noexcept { return settings_; }

 private:
  struct Measured {
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
  bool force_on_ = false, waits_ = false;
  std::int64_t joined_ns_ = kNotJoined;
  std::uint32_t sequence_ = 0;
  std::array<std::int64_t, 16> requested_ns_{};  // local, of the newest requests by their number
  std::uint32_t answered_ = 0;                   // newest request answered
  TimeWindow times_;                             // of the reference, as its answers state them
  std::deque<Measured> window_;
  ClockMap map_;
};

}  // namespace tactus::session
