/// Which numbers and times of a sender are plausible: the one rule for every received value that is compared as newer
/// or older.
///
///          far behind   |   overtaken   | newest |  plausible next  |  far ahead
///          -------------+---------------+--------+------------------+-----------
///          kImplausible |     kOld      |        |    kAccepted     |  kImplausible
///
/// A number may be ahead of the newest by `ahead`, plus `rate` times the time since the newest was accepted. A time may
/// be ahead of or behind our own clock, less the offset of the sender's clock, by a fixed length. What is farther off
/// is dropped, and the caller counts it. So one wrong sample costs one sample; it does not silence its sender.
///
/// A sender that really restarted or jumped is accepted again
///   - at once, when the same participant has a larger incarnation;
///   - after kAgreeing consecutive samples outside the window that are plausible successors of each other, each within
///     two seconds of the one before. A participant with a smaller incarnation, or another participant, needs as many
///     consecutive samples. Fencing numbers need not be consecutive, because others write under the number before at
///     the same time;
///   - at once, while only a single sample of the sender is known: nothing tells which of two was wrong.
/// All three give kAnew: what was built on earlier samples of that sender is to be forgotten.
///
/// Times are of the receiver's clock unless the name says otherwise. One thread at a time. Realtime.
#pragma once

#include <cstdint>

#include "session/messages.hpp"

namespace tactus::session {

/// Consecutive samples that agree with each other and not with the window: then the window was wrong.
inline constexpr unsigned kAgreeing = 3;

enum class Admission : std::uint8_t {
  kAccepted,    ///< follows what was accepted before
  kAnew,        ///< accepted, but it does not follow: the first, or the first after a restart or a jump
  kOld,         ///< not newer than the newest: overtaken or repeated
  kImplausible  ///< outside the window; to be dropped and counted
};

[[nodiscard]] constexpr bool accepted(Admission admission) noexcept {
  return admission == Admission::kAccepted || admission == Admission::kAnew;
}

/// How fast a number grows.
struct SequenceLimits {
  std::uint64_t ahead = 64;  ///< that losses and jitter explain without any time between two arrivals
  double rate = 1000;        ///< 1/s, at most
  bool repeats = false;      ///< several samples carry one number (an epoch): an equal number is accepted
  bool falls = true;         ///< false: a smaller number is never accepted after a confirmed larger one (fencing)
};

// A quarter of a second of each topic's largest rate, so that a wrong number inside the window costs no more than that.
inline constexpr SequenceLimits kCycleNumbers{256, 4000};                  ///< states, poses and commands
inline constexpr SequenceLimits kObjectPoseNumbers{64, 1000};              ///< poses of an object
inline constexpr SequenceLimits kClaimNumbers{16, 200};                    ///< claims and grants
inline constexpr SequenceLimits kHeartbeatNumbers{4, 100, true};           ///< of the roster
inline constexpr SequenceLimits kEpochNumbers{16, 1000, true};             ///< of demands
inline constexpr SequenceLimits kChunkNumbers{8192, 200'000};              ///< what a full credit holds; 1 Gbit/s
inline constexpr SequenceLimits kFencingNumbers{1024, 1000, true, false};  ///< of those who simulate an object

/// The numbers of one sender.
class SequenceWindow {
 public:
  explicit SequenceWindow(const SequenceLimits& limits) noexcept : limits_{limits} {}
  /// As if `number` had been accepted and confirmed before.
  SequenceWindow(const SequenceLimits& limits, std::uint64_t number, std::int64_t now_ns) noexcept
      : limits_{limits}, newest_{number}, newest_ns_{now_ns}, known_{true}, confirmed_{true} {}

  [[nodiscard]] Admission admit(std::uint64_t number, std::int64_t now_ns) noexcept;

  /// 0 before the first.
  [[nodiscard]] std::uint64_t newest() const noexcept { return newest_; }
  /// A second sample agreed with the first.
  [[nodiscard]] bool confirmed() const noexcept { return confirmed_; }

 private:
  [[nodiscard]] bool follows(std::uint64_t number, std::uint64_t before, std::int64_t passed_ns) const noexcept;
  [[nodiscard]] Admission begin(std::uint64_t number, std::int64_t now_ns, bool confirmed) noexcept;

  SequenceLimits limits_;
  std::uint64_t newest_ = 0;
  std::int64_t newest_ns_ = 0;
  bool known_ = false, confirmed_ = false;
  // The newest of the consecutive samples outside the window, and how many there are.
  std::uint64_t outside_ = 0;
  std::int64_t outside_ns_ = 0;
  unsigned outside_count_ = 0;
};

/// Who writes: of several programs that write the same thing, the one that counts now.
class SourceWindow {
 public:
  [[nodiscard]] Admission admit(const Origin& origin) noexcept;

 private:
  std::uint64_t participant_ = 0, incarnation_ = 0;
  bool known_ = false;
  std::uint64_t other_ = 0, other_incarnation_ = 0;
  unsigned other_count_ = 0;  // consecutive samples of the other
};

/// Both: samples that carry one number each.
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
  std::int64_t ahead_ns = 1'000'000'000;    ///< transit that gets shorter, clocks that are steered
  std::int64_t behind_ns = 10'000'000'000;  ///< transit that gets longer
};

/// The times that one sender states. Its clock need not agree with ours: the offset is learned, and follows the drift
/// of two crystals. Never gives kOld: a time that is behind by less than the limit was longer under way.
class TimeWindow {
 public:
  TimeWindow() noexcept = default;
  explicit TimeWindow(const TimeLimits& limits) noexcept : limits_{limits} {}
  [[nodiscard]] Admission admit(std::int64_t time_ns, std::int64_t now_ns) noexcept;

 private:
  [[nodiscard]] bool near(std::int64_t offset_ns, std::int64_t to_ns) const noexcept;

  TimeLimits limits_;
  std::int64_t offset_ns_ = 0, seen_ns_ = 0;  // sender's time less ours: the largest, so of the shortest transit
  bool known_ = false, confirmed_ = false;
  std::int64_t outside_ns_ = 0;  // offset of the newest consecutive sample outside
  unsigned outside_count_ = 0;
};

/// For times that are a 32-bit count of microseconds and wrap.
class WrappedTimeWindow {
 public:
  /// `transit_us`: our count less the sender's, modulo 2^32.
  [[nodiscard]] Admission admit(std::uint32_t transit_us, std::int64_t now_ns) noexcept;

 private:
  TimeWindow window_;
  std::uint32_t first_us_ = 0;
  bool known_ = false;
};

}  // namespace tactus::session
