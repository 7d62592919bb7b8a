/// Decides which received numbers and times of a sender are plausible. All receivers use this rule for each number or
/// time by which they decide whether a sample is newer than another.
///
///          far behind   |   overtaken   | newest |  plausible next  |  far ahead
///          -------------+---------------+--------+------------------+-----------
///          kImplausible |     kOld      |        |    kAccepted     |  kImplausible
///
/// A number may be ahead of the newest by `max_ahead`, plus `rate` times the time since the newest was accepted. A
/// time, corrected by the offset of the sender's clock, may differ from our clock by the amounts in TimeLimits. The
/// caller drops and counts a sample outside the window. So after one wrong sample, the next samples of its sender are
/// still accepted.
///
/// A sender whose numbers or times jump is accepted again
///   - at once, when the same participant has a larger incarnation;
///   - after kAgreeing consecutive samples outside the window, if each is a plausible successor of the one before. At
///     most two seconds may pass between two such numbers. A smaller incarnation or another participant needs kAgreeing
///     consecutive samples too. For fencing numbers, samples inside the window may arrive in between, because the
///     former owner still writes under the previous number;
///   - at once, if only one sample was accepted before, because that one may have been wrong.
/// In all three cases the result is kNewStart, and the caller has to drop state from earlier samples of the sender.
///
/// Times are of the receiver's clock unless the name says otherwise. One thread at a time. Realtime.
#pragma once

#include <cstdint>

#include "session/messages.hpp"

namespace tactus::session {

/// Number of consecutive samples outside the window, each plausible after the one before, that move the window to them.
inline constexpr unsigned kAgreeing = 3;

/// The decision on one number or time.
enum class Admission : std::uint8_t {
  kAccepted,    ///< plausible after the samples accepted before
  kNewStart,    ///< accepted as the first sample of the sender, or as the first after a restart or a jump
  kOld,         ///< overtaken or repeated: not newer than the newest
  kImplausible  ///< outside the window; the caller drops and counts it
};

[[nodiscard]] constexpr bool accepted(Admission admission) noexcept {
  return admission == Admission::kAccepted || admission == Admission::kNewStart;
}

/// The plausible growth of a number.
struct SequenceLimits {
  std::uint64_t max_ahead =
      64;                ///< max growth between two samples that arrive at the same time, after losses and jitter
  double rate = 1000;    ///< 1/s, max further growth
  bool repeats = false;  ///< an equal number is accepted, because several samples carry one number (an epoch)
  bool falls = true;     ///< false: a confirmed number up to kMaxFollowedFencing never decreases (fencing)
  std::uint64_t max_jump = UINT64_MAX;  ///< max number to which a confirmed window moves after kAgreeing samples
};

/// The largest fencing number to which samples of other programs can move a host. Hosts count up from their
/// incarnations, times in ns since 1970, and reach this number in the year 2116. From there to the end of the range,
/// the largest growth inside a window takes thousands of years. Other receivers accept jumps up to twice this number,
/// so they follow every host. A host accepts no jump above it, so a fencing number above it may decrease again.
inline constexpr std::uint64_t kMaxFollowedFencing = std::uint64_t{1} << 62;

// A wrong number inside the window makes a receiver refuse correct samples until their numbers are larger. At the
// topic's highest rate this takes about a quarter of a second, for heartbeats 0.4 s (decision 34).
inline constexpr SequenceLimits kCycleNumbers{256, 4000};         ///< probe states, device poses, commands and copies
inline constexpr SequenceLimits kObjectPoseNumbers{64, 1000};     ///< poses of an object
inline constexpr SequenceLimits kClaimNumbers{16, 200};           ///< claims and grants
inline constexpr SequenceLimits kHeartbeatNumbers{4, 100, true};  ///< of roster entries
inline constexpr SequenceLimits kEpochNumbers{16, 1000, true};    ///< of demands
inline constexpr SequenceLimits kChunkNumbers{8192, 200'000};     ///< of a stream: 8 MiB of max credit, 1 Gbit/s
inline constexpr SequenceLimits kFencingNumbers{1024, 1000, true, false, 2 * kMaxFollowedFencing};  ///< of an object
inline constexpr SequenceLimits kHostFencingNumbers{1024, 1000, true, false, kMaxFollowedFencing};  ///< in its host

/// Admits the numbers of one sender.
class SequenceWindow {
 public:
  explicit SequenceWindow(const SequenceLimits& limits) noexcept : limits_{limits} {}
  /// Starts with `number` accepted and confirmed.
  SequenceWindow(const SequenceLimits& limits, std::uint64_t number, std::int64_t now_ns) noexcept
      : limits_{limits}, newest_{number}, newest_ns_{now_ns}, started_{true}, confirmed_{true} {}

  [[nodiscard]] Admission admit(std::uint64_t number, std::int64_t now_ns) noexcept;

  /// Largest accepted number, or the first after a new start; 0: none.
  [[nodiscard]] std::uint64_t newest() const noexcept { return newest_; }
  /// Whether a second sample was plausible after the first.
  [[nodiscard]] bool confirmed() const noexcept { return confirmed_; }

 private:
  [[nodiscard]] bool is_successor(std::uint64_t number, std::uint64_t before, std::int64_t passed_ns) const noexcept;
  [[nodiscard]] Admission start(std::uint64_t number, std::int64_t now_ns, bool confirmed) noexcept;

  SequenceLimits limits_;
  std::uint64_t newest_ = 0;
  std::int64_t newest_ns_ = 0;
  bool started_ = false, confirmed_ = false;
  // Newest of the consecutive samples outside the window, its arrival, and their number.
  std::uint64_t outside_ = 0;
  std::int64_t outside_ns_ = 0;
  unsigned outside_count_ = 0;
};

/// Admits one program at a time, where several programs may write the samples of one key.
class SourceWindow {
 public:
  [[nodiscard]] Admission admit(const Origin& origin) noexcept;

 private:
  std::uint64_t participant_ = 0, incarnation_ = 0;
  bool started_ = false;
  std::uint64_t other_ = 0, other_incarnation_ = 0;
  unsigned other_count_ = 0;  // consecutive samples of this other program
};

/// Admits the samples of one program at a time, by their numbers.
class SenderWindow {
 public:
  explicit SenderWindow(const SequenceLimits& limits) noexcept : limits_{limits}, numbers_{limits} {}
  [[nodiscard]] Admission admit(const Origin& origin, std::uint64_t number, std::int64_t now_ns) noexcept;

 private:
  SequenceLimits limits_;
  SourceWindow source_;
  SequenceWindow numbers_;
};

struct TimeLimits {
  std::int64_t max_ahead_ns = 1'000'000'000;    ///< for a transit that gets shorter, and for clocks that are steered
  std::int64_t max_behind_ns = 10'000'000'000;  ///< for a transit that gets longer
};

/// Admits the sending times of one sender. The sender's clock may differ from ours: the window learns the offset and
/// its drift. Never returns kOld, because a sample with an older time may only have had a longer transit.
class TimeWindow {
 public:
  TimeWindow() noexcept = default;
  explicit TimeWindow(const TimeLimits& limits) noexcept : limits_{limits} {}
  [[nodiscard]] Admission admit(std::int64_t time_ns, std::int64_t now_ns) noexcept;

 private:
  [[nodiscard]] bool is_plausible(std::int64_t offset_ns, std::int64_t expected_ns) const noexcept;

  TimeLimits limits_;
  std::int64_t offset_ns_ = 0;    // max of sender's time minus ours: from the sample with the shortest transit
  std::int64_t accepted_ns_ = 0;  // our time of the last accepted sample
  bool started_ = false, confirmed_ = false;
  std::int64_t outside_ns_ = 0;  // offset of the newest consecutive sample outside the window
  unsigned outside_count_ = 0;
};

/// Admits times that are a 32-bit count of microseconds, modulo 2^32.
class WrappedTimeWindow {
 public:
  /// `transit_us`: our count minus the sender's, modulo 2^32.
  [[nodiscard]] Admission admit(std::uint32_t transit_us, std::int64_t now_ns) noexcept;

 private:
  TimeWindow window_;
  std::uint32_t first_us_ = 0;
  bool started_ = false;
};

}  // namespace tactus::session
