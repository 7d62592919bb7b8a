/// The plausible range of a sender's numbers and times: the one rule for every received value that is compared as newer
/// or older.
///
///          far behind   |   overtaken   | newest |  plausible next  |  far ahead
///          -------------+---------------+--------+------------------+-----------
///          kImplausible |     kOld      |        |    kAccepted     |  kImplausible
///
/// A number may be ahead of the newest by `ahead`, plus `rate` times the time since the newest was accepted. A time,
/// corrected by the offset of the sender's clock, may differ from our clock by a fixed amount. A sample outside the
/// window is dropped, and the caller counts it. So one wrong sample costs one sample; it does not silence its sender.
///
/// A sender that restarted or jumped is accepted again
///   - at once, when the same participant has a larger incarnation;
///   - after kAgreeing consecutive samples outside the window that are plausible successors of each other, each within
///     two seconds of the one before. A participant with a smaller incarnation, or another participant, needs as many
///     consecutive samples. Fencing numbers need not be consecutive, because others still write under the previous
///     number at the same time;
///   - at once, after a single sample of the sender: either of the two may be the wrong one.
/// All three return kAnew: the caller has to drop state from earlier samples of that sender.
///
/// Times are of the receiver's clock unless the name says otherwise. One thread at a time. Realtime.
#pragma once

#include <cstdint>

#include "session/messages.hpp"

namespace tactus::session {

/// Consecutive samples outside the window that agree with each other; then the window is moved to them.
inline constexpr unsigned kAgreeing = 3;

enum class Admission : std::uint8_t {
  kAccepted,    ///< follows the samples accepted before
  kAnew,        ///< accepted without a predecessor: the first, or the first after a restart or a jump
  kOld,         ///< not newer than the newest: overtaken or repeated
  kImplausible  ///< outside the window; the caller drops and counts it
};

[[nodiscard]] constexpr bool accepted(Admission admission) noexcept {
  return admission == Admission::kAccepted || admission == Admission::kAnew;
}

/// The plausible growth of a number.
struct SequenceLimits {
  std::uint64_t ahead = 64;  ///< max growth by losses and jitter, without time between two arrivals
  double rate = 1000;        ///< 1/s, max rate
  bool repeats = false;      ///< several samples carry one number (an epoch): an equal number is accepted
  bool falls = true;         ///< false: a smaller number is never accepted after a confirmed larger one (fencing)
};

// `ahead` is a quarter of a second at the topic's highest rate: a wrong number inside the window costs no more.
inline constexpr SequenceLimits kCycleNumbers{256, 4000};                  ///< states, poses and commands
inline constexpr SequenceLimits kObjectPoseNumbers{64, 1000};              ///< poses of an object
inline constexpr SequenceLimits kClaimNumbers{16, 200};                    ///< claims and grants
inline constexpr SequenceLimits kHeartbeatNumbers{4, 100, true};           ///< of the roster
inline constexpr SequenceLimits kEpochNumbers{16, 1000, true};             ///< of demands
inline constexpr SequenceLimits kChunkNumbers{8192, 200'000};              ///< the max credit; 1 Gbit/s
inline constexpr SequenceLimits kFencingNumbers{1024, 1000, true, false};  ///< of the owners of an object

/// The numbers of one sender.
class SequenceWindow {
 public:
  explicit SequenceWindow(const SequenceLimits& limits) noexcept : limits_{limits} {}
  /// Starts with `number` accepted and confirmed.
  SequenceWindow(const SequenceLimits& limits, std::uint64_t number, std::int64_t now_ns) noexcept
      : limits_{limits}, newest_{number}, newest_ns_{now_ns}, started_{true}, confirmed_{true} {}

  [[nodiscard]] Admission admit(std::uint64_t number, std::int64_t now_ns) noexcept;

  /// 0 before the first.
  [[nodiscard]] std::uint64_t newest() const noexcept { return newest_; }
  /// Whether a second sample has agreed with the first.
  [[nodiscard]] bool confirmed() const noexcept { return confirmed_; }

 private:
  [[nodiscard]] bool follows(std::uint64_t number, std::uint64_t before, std::int64_t passed_ns) const noexcept;
  [[nodiscard]] Admission begin(std::uint64_t number, std::int64_t now_ns, bool confirmed) noexcept;

  SequenceLimits limits_;
  std::uint64_t newest_ = 0;
  std::int64_t newest_ns_ = 0;
  bool started_ = false, confirmed_ = false;
  // The newest of the consecutive samples outside the window, and how many there are.
  std::uint64_t outside_ = 0;
  std::int64_t outside_ns_ = 0;
  unsigned outside_count_ = 0;
};

/// The current writer, where several programs may write the same samples.
class SourceWindow {
 public:
  [[nodiscard]] Admission admit(const Origin& origin) noexcept;

 private:
  std::uint64_t participant_ = 0, incarnation_ = 0;
  bool started_ = false;
  std::uint64_t other_ = 0, other_incarnation_ = 0;
  unsigned other_count_ = 0;  // consecutive samples of the other
};

/// A SourceWindow and a SequenceWindow, for samples that carry one number each.
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
  std::int64_t ahead_ns = 1'000'000'000;    ///< for a transit that gets shorter, and for clocks that are steered
  std::int64_t behind_ns = 10'000'000'000;  ///< for a transit that gets longer
};

/// The times stated by one sender. Its clock need not agree with ours: the window learns the offset and follows the
/// drift. Never returns kOld: a time that is behind by less than the limit only had a longer transit.
class TimeWindow {
 public:
  TimeWindow() noexcept = default;
  explicit TimeWindow(const TimeLimits& limits) noexcept : limits_{limits} {}
  [[nodiscard]] Admission admit(std::int64_t time_ns, std::int64_t now_ns) noexcept;

 private:
  [[nodiscard]] bool near(std::int64_t offset_ns, std::int64_t to_ns) const noexcept;

  TimeLimits limits_;
  std::int64_t offset_ns_ = 0, seen_ns_ = 0;  // sender's time minus ours: the max, which has the shortest transit
  bool started_ = false, confirmed_ = false;
  std::int64_t outside_ns_ = 0;  // offset of the newest consecutive sample outside
  unsigned outside_count_ = 0;
};

/// For times that are a wrapping 32-bit count of microseconds.
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
