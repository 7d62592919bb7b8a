#include "bench/coded_run.hpp"

#include <algorithm>
#include <cmath>

#include "session/units.hpp"

namespace tactus::bench {
namespace {

constexpr std::int64_t kAdaptationNs = 1000 * kMs;

using Vec = std::array<double, 3>;

Vec interpolate(const Vec& a, const Vec& b, double share) {
  return {a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])};
}
double distance(const Vec& a, const Vec& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

}  // namespace

std::vector<std::uint32_t> encode(const States& states, const session::CodingSettings& settings) {
  session::ProbeEncoder encoder{settings};
  std::vector<std::uint32_t> sent;
  for (std::uint32_t i = 0; i < states.size(); ++i)
    if (encoder.step(states[i])) sent.push_back(i);
  return sent;
}

std::vector<CodedArrival> arrivals_without_delay(const States& states, const std::vector<std::uint32_t>& sent) {
  std::vector<CodedArrival> arrivals;
  for (const std::uint32_t index : sent) arrivals.push_back({states[index].session_time_ns, index});
  return arrivals;
}

Fidelity play(const States& states, const std::vector<std::uint32_t>& sent, const std::vector<CodedArrival>& arrivals,
              const session::PlayoutSettings& settings, const session::Jnd& jnd) {
  std::vector<std::uint32_t> sequence_numbers(states.size(), 0);
  for (std::uint32_t i = 0; i < sent.size(); ++i) sequence_numbers[sent[i]] = i + 1;
  session::ProbePlayout playout{settings};
  Fidelity result;
  double squares = 0, jnd_squares = 0;
  std::size_t above_count = 0, measured = 0, next = 0;
  for (std::int64_t cycle = 0; cycle <= states.back().session_time_ns; cycle += kMs) {
    const std::int64_t now = cycle + playout.delay_ns() % kMs;  // the view then has the session time of a cycle
    for (; next < arrivals.size() && arrivals[next].at_ns <= now; ++next) {
      session::ProbeState state = states[arrivals[next].index];
      state.sequence = sequence_numbers[arrivals[next].index];
      playout.on_state(state, arrivals[next].at_ns);
    }
    const session::ShownProbe shown = playout.view_at(now);
    if (now < kAdaptationNs || shown.at_ns < 0) continue;
    const auto index = static_cast<std::size_t>(shown.at_ns / kMs);
    if (index + 1 >= states.size()) break;
    const session::ProbeState &before = states[index], &after = states[index + 1];
    const double share = static_cast<double>(shown.at_ns - before.session_time_ns) / static_cast<double>(kMs);
    const Vec felt = interpolate(before.force, after.force, share);
    const double error_jnd = jnd.force_difference(felt, shown.view.force);
    result.jnd.add(error_jnd);
    result.position.add(distance(interpolate(before.device.position, after.device.position, share), shown.view.device));
    result.delay.add(static_cast<double>(now - shown.at_ns) * 1e-6);
    above_count += error_jnd > 1 + 1e-9 ? 1 : 0;
    jnd_squares += error_jnd * error_jnd;
    squares += std::pow(distance(felt, shown.view.force), 2);
    ++measured;
  }
  const auto count = static_cast<double>(std::max<std::size_t>(measured, 1));
  result.rms_jnd = std::sqrt(jnd_squares / count);
  result.rms_force = std::sqrt(squares / count);
  result.above_share = static_cast<double>(above_count) / count;
  return result;
}

}  // namespace tactus::bench
