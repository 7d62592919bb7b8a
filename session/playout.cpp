#include "session/playout.hpp"

#include <algorithm>

namespace tactus::session {
namespace {

std::array<double, 3> interpolate(const std::array<double, 3>& a, const std::array<double, 3>& b,
                                  double share) noexcept {
  return {a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])};
}

}  // namespace

void ProbePlayout::on_state(const ProbeState& state, std::int64_t session_now_ns) noexcept {
  constexpr std::int64_t kStepNs = 100'000'000;  // longer than any reordering
  const bool restarted = count_ > 0 && states_[0].origin.incarnation != state.origin.incarnation;
  const bool stepped_back = started_ && session_now_ns < updated_ns_ - kStepNs;
  if (restarted || stepped_back) *this = ProbePlayout{settings_};
  insert(state);
  update_delay(session_now_ns - state.session_time_ns, session_now_ns);
}

void ProbePlayout::insert(const ProbeState& state) noexcept {
  const auto begin = states_.begin();
  const auto by_sequence = [](const ProbeState& a, const ProbeState& b) { return a.sequence < b.sequence; };
  if (count_ == kCapacity) {
    if (by_sequence(state, states_[0])) return;
    std::move(begin + 1, begin + kCapacity, begin);
    --count_;
  }
  const auto at = std::lower_bound(begin, begin + count_, state, by_sequence);
  if (at != begin + count_ && at->sequence == state.sequence) return;
  std::move_backward(at, begin + count_, begin + count_ + 1);
  *at = state;
  ++count_;
}

void ProbePlayout::update_delay(std::int64_t transit_ns, std::int64_t now_ns) noexcept {
  transit_.on_transit(transit_ns, now_ns);
  const std::int64_t wanted =
      std::clamp<std::int64_t>(transit_.max_ns() + settings_.reserve_ns, 0, settings_.max_delay_ns);
  const std::int64_t fall = started_ ? std::max<std::int64_t>(now_ns - updated_ns_, 0) / 100 : INT64_MAX;
  delay_ns_ = wanted >= delay_ns_ - fall ? wanted : delay_ns_ - fall;
  updated_ns_ = now_ns;
  started_ = true;
}

ShownProbe ProbePlayout::view_at(std::int64_t session_now_ns) noexcept {
  ShownProbe shown;
  shown_ns_ = std::max(shown_ns_, session_now_ns - delay_ns_);
  shown.at_ns = shown_ns_;
  if (count_ == 0) return shown;
  const auto begin = states_.begin(), end = begin + count_;
  auto next = std::find_if(begin, end, [&](const ProbeState& state) { return state.session_time_ns > shown_ns_; });
  const ProbeState& state = next == begin ? *begin : *(next - 1);
  shown.state = state;
  shown.stale = session_now_ns - states_[count_ - 1].session_time_ns > 3 * kKeepAliveNs + delay_ns_;
  shown.view = extrapolate(state, shown_ns_);
  if (next != begin && next != end && next->sequence != state.sequence + 1) {  // states between them were lost
    const double share = static_cast<double>(shown_ns_ - state.session_time_ns) /
                         static_cast<double>(next->session_time_ns - state.session_time_ns);
    shown.view = {interpolate(state.device.position, next->device.position, share),
                  interpolate(state.proxy, next->proxy, share), interpolate(state.force, next->force, share)};
  }
  return shown;
}

}  // namespace tactus::session
