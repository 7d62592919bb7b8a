#include "session/remote_probe.hpp"

#include <algorithm>

namespace tactus::session {

void RemoteProbe::count(const ProbeState& state) noexcept {
  constexpr double kMemory = 100;       // states
  constexpr std::uint32_t kMost = 100;  // a longer silence is no loss of single ones
  if (coded_ != 0 && state.sequence > coded_) {
    const std::uint32_t missing = state.sequence - coded_ - 1;
    for (std::uint32_t i = 0; i < missing && missing <= kMost; ++i) lost_ += (1 - lost_) / kMemory;
    lost_ -= lost_ / kMemory;
  }
  coded_ = std::max(coded_, state.sequence);
}

void RemoteProbe::on_state(const ProbeState& state, StateStream stream, std::int64_t session_now_ns) noexcept {
  if (state.origin.incarnation < incarnation_) return;
  if (state.origin.incarnation > incarnation_) *this = RemoteProbe{coded_settings_};
  incarnation_ = state.origin.incarnation;
  if (stream == StateStream::kCoded) count(state);
  if (stream == StateStream::kWhole) whole_ns_ = session_now_ns;
  const StateStream now = session_now_ns - whole_ns_ < kWholeNs ? StateStream::kWhole : StateStream::kCoded;
  if (stream != now) return;
  if (now != stream_) {
    stream_ = now;
    offset_ = newest_ + 2 - state.sequence;  // not the next number: between them lies what was not heard
    playout_.set(now == StateStream::kWhole ? PlayoutSettings{0, 0} : coded_settings_);
  }
  ProbeState kept = state;
  kept.sequence += offset_;
  newest_ = std::max(newest_, kept.sequence);
  playout_.on_state(kept, session_now_ns);
}

}  // namespace tactus::session
