/// A probe of somebody else as its states tell: by which stream it is known, what to show of it, how much gets lost.
///
/// Its states come coded, to everyone, and while it collaborates with a user here also whole, one a cycle. Whole ones
/// count as long as they come and are shown at once; else the coded ones are, played out (session/playout.hpp). At a
/// change of stream what is shown goes straight from the last state of the one to the first of the other, and its
/// delay follows slowly, so nothing jumps.
///
/// A state counts when its number and time are plausible (session/sequence_window.hpp). A user may move to another
/// controller: its states count after three consecutive ones, whenever that controller was started.
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
      : compressed_settings_{settings}, playout_{settings} {}

  /// Says whether the state counts; kAnew: nothing before it does; kOld: it fills a gap, but is not the newest.
  [[nodiscard]] Admission on_state(const ProbeState& state, StateStream stream, std::int64_t session_now_ns) noexcept;
  [[nodiscard]] Shown at(std::int64_t session_now_ns) noexcept { return playout_.at(session_now_ns); }

  [[nodiscard]] StateStream stream() const noexcept { return stream_; }
  [[nodiscard]] std::int64_t delay_ns() const noexcept { return playout_.delay_ns(); }
  /// Share of the coded states that did not come, over the last hundred or so.
  [[nodiscard]] double lost() const noexcept { return lost_; }

 private:
  static constexpr std::int64_t kFullRateNs = 20'000'000;  // silence after which the coded ones count again

  void begin_anew() noexcept;
  void count(const ProbeState& state) noexcept;

  PlayoutSettings compressed_settings_;
  ProbePlayout playout_;
  StateStream stream_ = StateStream::kDeadbandCoded;
  SourceWindow source_;
  SequenceWindow numbers_[2]{SequenceWindow{kCycleNumbers}, SequenceWindow{kCycleNumbers}};  // by StateStream
  TimeWindow time_;
  std::int64_t full_rate_ns_ = INT64_MIN / 2;  // the last whole one came
  std::uint32_t coded_ = 0;                    // newest number among the coded
  std::uint32_t offset_ = 0, newest_ = 0;      // playout's numbers: this stream's and offset_
  double lost_ = 0;
};

}  // namespace tactus::session
