#include "session/remote_probe.hpp"

#include <algorithm>

namespace tactus::session {

void RemoteProbe::count(const ProbeState& state) noexcept {
  constexpr double kMemory = 100;      // states
  constexpr std::uint32_t kMax = 100;  // a longer gap is an interruption, not a loss of single states
  if (newest_coded_ != 0 && state.sequence > newest_coded_) {
    const std::uint32_t missing = state.sequence - newest_coded_ - 1;
    for (std::uint32_t i = 0; i < missing && missing <= kMax; ++i) lost_share_ += (1 - lost_share_) / kMemory;
    lost_share_ -= lost_share_ / kMemory;
  }
  newest_coded_ = std::max(newest_coded_, state.sequence);
}

/// Resets playout and losses, but not the plausible windows.
void RemoteProbe::restart() noexcept {
  playout_ = ProbePlayout{deadband_settings_};
  stream_ = StateStream::kDeadbandCoded;
  full_rate_ns_ = INT64_MIN / 2;
  newest_coded_ = offset_ = newest_ = 0;
  lost_share_ = 0;
}

Admission RemoteProbe::on_state(const ProbeState& state, StateStream stream, std::int64_t session_now_ns) noexcept {
  const Admission source = source_.admit(state.origin);
  if (source == Admission::kImplausible) return source;
  if (source == Admission::kNewStart) {
    for (SequenceWindow& numbers : numbers_) numbers = SequenceWindow{kCycleNumbers};
    time_ = TimeWindow{};
  }
  SequenceWindow& numbers = numbers_[static_cast<std::size_t>(stream)];
  const bool first = numbers.newest() == 0;
  const Admission number = numbers.admit(state.sequence, session_now_ns);
  if (number == Admission::kImplausible) return number;
  const Admission time = time_.admit(state.session_time_ns, session_now_ns);
  if (time == Admission::kImplausible) return time;
  // The first state of the second stream is not a new start, because the first stream goes on.
  const bool jumped = number == Admission::kNewStart && !first;
  const bool is_new_start = source == Admission::kNewStart || jumped || (time == Admission::kNewStart && newest_ != 0);
  if (is_new_start) restart();
  const Admission admission = is_new_start                ? Admission::kNewStart
                              : number == Admission::kOld ? number
                                                          : Admission::kAccepted;
  if (stream == StateStream::kDeadbandCoded) count(state);
  if (stream == StateStream::kFullRate) full_rate_ns_ = session_now_ns;
  const StateStream now =
      session_now_ns - full_rate_ns_ < kFullRateNs ? StateStream::kFullRate : StateStream::kDeadbandCoded;
  if (stream != now) return admission;
  if (now != stream_) {
    stream_ = now;
    offset_ = newest_ + 2 - state.sequence;  // skips a number, so that the playout interpolates between the streams
    playout_.set(now == StateStream::kFullRate ? PlayoutSettings{0, 0} : deadband_settings_);
  }
  ProbeState renumbered = state;
  renumbered.sequence += offset_;
  newest_ = std::max(newest_, renumbered.sequence);
  playout_.on_state(renumbered, session_now_ns);
  return admission;
}

}  // namespace tactus::session
