#include "session/probe_coding.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::session {
namespace {

using Vec = std::array<double, 3>;

/// A change of these bits is sent at once.
constexpr std::uint32_t kSentAtOnce =
    kInContact | kExact | kStalePose | kHolding | kHoldRefused | kFault | kFaultReason;

double dot(const Vec& a, const Vec& b) noexcept { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vec along(const Vec& from, const Vec& direction, double share) noexcept {
  return {from[0] + share * direction[0], from[1] + share * direction[1], from[2] + share * direction[2]};
}
double distance(const Vec& a, const Vec& b) noexcept { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

/// Time by which to extrapolate between two times, s. After a keep-alive period it grows ever more slowly to a limit.
double motion(std::int64_t from_ns, std::int64_t to_ns) noexcept {
  constexpr double kFullMotionS = static_cast<double>(kKeepAliveNs) * 1e-9, kDecay = 0.02;
  const double seconds = static_cast<double>(to_ns - from_ns) * 1e-9;
  return seconds <= kFullMotionS ? std::max(seconds, -kFullMotionS)
                                 : kFullMotionS + kDecay * (1 - std::exp((kFullMotionS - seconds) / kDecay));
}

}  // namespace

double Jnd::force_difference(const Vec& felt, const Vec& shown) const noexcept {
  return distance(felt, shown) / std::max(force_share * std::sqrt(dot(felt, felt)), force_floor);
}

ProbeView extrapolate(const ProbeState& state, std::int64_t at_ns) noexcept {
  const double seconds = motion(state.session_time_ns, at_ns);
  ProbeView view{along(state.device.position, state.velocity, seconds), state.proxy, state.force};
  const double depth = distance(state.proxy, state.device.position);
  if ((state.status & kInContact) == 0 || depth == 0) {
    view.proxy = along(state.proxy, state.velocity, seconds);
    return view;
  }
  const Vec spring = along(state.proxy, state.device.position, -1);  // device to proxy
  const double outwards = dot(state.velocity, spring) / depth;       // speed out of the surface
  view.proxy = along(state.proxy, along(state.velocity, spring, -outwards / depth), seconds);
  const double deeper = std::max(-depth, -outwards * seconds);
  view.force = along(state.force, spring, static_cast<double>(state.stiffness) * deeper / depth);
  return view;
}

bool ProbeEncoder::misleads(const ProbeState& sent, const ProbeState& state) const noexcept {
  if (((sent.status ^ state.status) & kSentAtOnce) != 0 || sent.object_id != state.object_id) return true;
  const ProbeView view = extrapolate(sent, state.session_time_ns);
  return settings_.jnd.force_difference(state.force, view.force) > 1 ||
         distance(state.device.position, view.device) > settings_.jnd.position ||
         distance(state.proxy, view.proxy) > settings_.jnd.position;
}

bool ProbeEncoder::step(const ProbeState& state) noexcept {
  bool send = count_ == 0;
  if (!send) {
    const ProbeState& last = sent_[(count_ - 1) % kSent];
    const std::int64_t passed_ns = state.session_time_ns - last.session_time_ns;
    send = passed_ns >= kKeepAliveNs || passed_ns < 0;  // < 0: session time has stepped
    // With probability loss^back (1 - loss), the receiver's newest state is the one that was sent `back` before the
    // last.
    double likely = 1 - settings_.loss, misled = 0;
    const std::size_t stored = std::min<std::uint64_t>(count_, kSent);
    for (std::size_t back = 0; back < stored && likely > 0 && !send; ++back, likely *= settings_.loss) {
      if (misleads(sent_[(count_ - 1 - back) % kSent], state)) misled += likely;
      send = misled > settings_.risk;
    }
  }
  if (send) sent_[count_++ % kSent] = state;
  return send;
}

}  // namespace tactus::session
