#include "latency/schedule.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "session/probe_coding.hpp"

namespace tactus::latency {
namespace {

struct Wave {
  double value, rate;  // m, m/s
};
Wave wave(double amplitude, double hz, double seconds) {
  const double angular = 2 * 3.14159265358979323846 * hz;
  return {amplitude * std::sin(angular * seconds), amplitude * angular * std::cos(angular * seconds)};
}

session::ProbeState state_at(double seconds) {
  constexpr double kStiffness = 1000, kMeanDepth = 0.0006;  // N/m, m
  const Wave along = wave(0.016, 0.5, seconds), press = wave(0.0009, 0.667, seconds), tremor = wave(0.0001, 9, seconds);
  const double depth = kMeanDepth + press.value + tremor.value;
  session::ProbeState state;
  state.session_time_ns = std::llround(seconds * 1e9);
  state.device.position = {along.value, 0, -depth};
  state.velocity = {along.rate, 0, -press.rate - tremor.rate};
  state.proxy = {along.value, 0, std::max(-depth, 0.0)};
  state.force = {0, 0, kStiffness * std::max(depth, 0.0)};
  if (depth > 0) state.status = session::kInContact;
  return state;
}

}  // namespace

std::vector<std::uint32_t> ticks_of(const TestCase& test) {
  std::vector<std::uint32_t> ticks(test.ticks());
  std::iota(ticks.begin(), ticks.end(), 0u);
  if (test.coding == Coding::kNone) return ticks;
  session::ProbeEncoder encoder;
  std::vector<std::uint32_t> sent;
  for (const std::uint32_t tick : ticks)
    if (encoder.step(state_at(tick / test.rate_hz))) sent.push_back(tick);
  return sent;
}

}  // namespace tactus::latency
