/// A probe of another HRTC: selects the stream of states to show, and measures the losses.
///
/// Everyone receives its deadband-coded states. While its user collaborates with a user here, full-rate states come as
/// well, one a cycle. Full-rate states are shown at once, as long as they come; otherwise the deadband-coded ones are
/// shown through a playout buffer (session/playout.hpp). At a change of stream the view is interpolated from the last
/// state of the one to the first of the other, and the delay changes gradually, so nothing jumps.
///
/// A state counts when its number and time are plausible (session/sequence_window.hpp). When a user moves to another
/// HRTC, the new HRTC's states count after three consecutive ones, whenever that HRTC was started.
///
/// Times are session time. One thread at a time. Does not allocate.
#pragma once

#include <cstdint>

#include "session/playout.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

enum class StateStream : std::uint8_t { kDeadbandCoded, kFullRate };

class RemoteProbe {
 public:
  explicit RemoteProbe(const PlayoutSettings& settings = {}) noexcept
      : deadband_settings_{settings}, playout_{settings} {}

  /// Returns whether the state counts; kAnew: earlier states do not; kOld: it fills a gap, but is not the newest.
  [[nodiscard]] Admission on_state(const ProbeState& state, StateStream stream, std::int64_t session_now_ns) noexcept;
  [[nodiscard]] Shown at(std::int64_t session_now_ns) noexcept { return playout_.at(session_now_ns); }

  [[nodiscard]] StateStream stream() const noexcept { return stream_; }
  [[nodiscard]] std::int64_t delay_ns() const noexcept { return playout_.delay_ns(); }
  /// Share of the last 100 deadband-coded states that were lost.
  [[nodiscard]] double lost() const noexcept { return lost_; }

 private:
  static constexpr std::int64_t kFullRateNs = 20'000'000;  // silence after which deadband-coded states are shown again

  void begin_anew() noexcept;
  void count(const ProbeState& state) noexcept;

  PlayoutSettings deadband_settings_;
  ProbePlayout playout_;
  StateStream stream_ = StateStream::kDeadbandCoded;
  SourceWindow source_;
  SequenceWindow numbers_[2]{SequenceWindow{kCycleNumbers}, SequenceWindow{kCycleNumbers}};  // by StateStream
  TimeWindow time_;
  std::int64_t full_rate_ns_ = INT64_MIN / 2;  // arrival of the last full-rate state
  std::uint32_t newest_coded_ = 0;             // largest number of a deadband-coded state
  std::uint32_t offset_ = 0, newest_ = 0;      // numbers in the playout: number in the stream plus offset_
  double lost_ = 0;
};

}  // namespace tactus::session
