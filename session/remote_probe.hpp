/// Selects which states of a remote probe are shown, and measures the losses.
///
/// All programs receive the deadband-coded states of the probe. While its user collaborates with a user of this HRTC,
/// its full-rate states arrive as well, one each cycle. While full-rate states arrive, they are shown at once.
/// Otherwise the deadband-coded states are shown with a playout delay (session/playout.hpp). At a change of stream the
/// view is interpolated between the last state of one stream and the first of the other. The delay falls gradually;
/// while it rises, the shown time stands still. So the view does not jump.
///
/// A state is accepted when its number and time are plausible (session/sequence_window.hpp). When a user moves to
/// another HRTC, the states of that HRTC are accepted after three consecutive ones.
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

  /// Takes a state. Returns kNewStart when earlier states no longer count. Returns kOld for a repeated state, and for
  /// an overtaken state, which can still fill a gap.
  [[nodiscard]] Admission on_state(const ProbeState& state, StateStream stream, std::int64_t session_now_ns) noexcept;
  [[nodiscard]] ShownProbe view_at(std::int64_t session_now_ns) noexcept { return playout_.view_at(session_now_ns); }

  [[nodiscard]] StateStream stream() const noexcept { return stream_; }
  [[nodiscard]] std::int64_t delay_ns() const noexcept { return playout_.delay_ns(); }
  /// Share of the deadband-coded states that were lost, averaged over about the last 100.
  [[nodiscard]] double lost_share() const noexcept { return lost_share_; }

 private:
  static constexpr std::int64_t kFullRateNs =
      20'000'000;  // time without full-rate states until deadband-coded ones are shown

  void restart() noexcept;
  void count(const ProbeState& state) noexcept;

  PlayoutSettings deadband_settings_;
  ProbePlayout playout_;
  StateStream stream_ = StateStream::kDeadbandCoded;
  SourceWindow source_;
  SequenceWindow numbers_[2]{SequenceWindow{kCycleNumbers}, SequenceWindow{kCycleNumbers}};  // by StateStream
  TimeWindow time_;
  std::int64_t full_rate_ns_ = INT64_MIN / 2;  // arrival of the last full-rate state
  std::uint32_t newest_coded_ = 0;             // largest number of a deadband-coded state
  std::uint32_t offset_ = 0, newest_ = 0;      // a number in the playout is the number in the stream plus offset_
  double lost_share_ = 0;
};

}  // namespace tactus::session
