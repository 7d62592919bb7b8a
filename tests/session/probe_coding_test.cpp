#include "session/probe_coding.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

double distance(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/// The state of a probe in contact with the plane z = 0, at `depth` below the plane, with 1000 N/m.
ProbeState in_contact(double depth, const std::array<double, 3>& velocity, std::int64_t at_ns) {
  ProbeState state;
  state.session_time_ns = at_ns;
  state.device.position = {0.1, 0.2, -depth};
  state.proxy = {0.1, 0.2, 0};
  state.velocity = velocity;
  state.stiffness = 1000;
  state.force = {0, 0, 1000 * depth};
  state.status = kInContact | kExact;
  state.object_id = 1;
  return state;
}

/// States of a hand that moves at random near the plane z = 0 for `seconds`, mostly in contact.
std::vector<ProbeState> random_motion(double seconds, std::uint32_t seed) {
  std::mt19937 random{seed};
  std::normal_distribution<> velocity_change{0, 0.004};
  std::array<double, 3> position{0, 0, -0.001}, velocity{0, 0, 0};
  std::vector<ProbeState> states;
  for (std::int64_t ms = 0; ms < std::lround(seconds * 1e3); ++ms) {
    const double rest_position[] = {0, 0, -0.001};
    for (int axis = 0; axis < 3; ++axis) {
      velocity[axis] += velocity_change(random) - 0.02 * velocity[axis] - 0.3 * (position[axis] - rest_position[axis]);
      position[axis] += 1e-3 * velocity[axis];
    }
    ProbeState state = in_contact(std::max(0.0, -position[2]), velocity, ms * kMs);
    state.device.position = state.proxy = position;
    state.proxy[2] = std::max(0.0, position[2]);
    if (position[2] > 0) {
      state.status = kExact;
      state.object_id = 0;
      state.stiffness = 0;
    }
    states.push_back(state);
  }
  return states;
}

TEST(Extrapolate, MovesAFreeProbeForwardsAndBackwards) {
  ProbeState state;
  state.session_time_ns = 100 * kMs;
  state.device.position = state.proxy = {1, 2, 3};
  state.velocity = {0.1, 0, -0.2};
  for (const std::int64_t ms : {-10, 0, 25}) {
    const double seconds = static_cast<double>(ms) * 1e-3;
    const ProbeView view = extrapolate(state, (100 + ms) * kMs);
    EXPECT_NEAR(distance(view.device, {1 + 0.1 * seconds, 2, 3 - 0.2 * seconds}), 0, 1e-15);
    EXPECT_NEAR(distance(view.proxy, view.device), 0, 1e-15);
    EXPECT_EQ(distance(view.force, {0, 0, 0}), 0);
  }
}

TEST(Extrapolate, MovesAContactAsASpringOnAPlane) {
  const ProbeState state = in_contact(0.002, {0.05, -0.02, -0.03}, 0);
  const ProbeView view = extrapolate(state, 20 * kMs);
  EXPECT_NEAR(distance(view.device, {0.101, 0.1996, -0.0026}), 0, 1e-12);
  EXPECT_NEAR(distance(view.proxy, {0.101, 0.1996, 0}), 0, 1e-12) << "the proxy stays on the surface";
  EXPECT_NEAR(distance(view.force, {0, 0, 2.6}), 0, 1e-9);
}

TEST(Extrapolate, TheForceIsZeroOnceTheDeviceLeavesTheSurface) {
  const ProbeView view = extrapolate(in_contact(0.001, {0, 0, 0.2}, 0), 30 * kMs);
  EXPECT_NEAR(distance(view.force, {0, 0, 0}), 0, 1e-9);
}

TEST(Extrapolate, MotionFadesOutAfterAKeepAlivePeriod) {
  const ProbeState state = in_contact(0.002, {0.1, 0, 0}, 0);
  const double at_end = extrapolate(state, kKeepAliveNs).device[0],
               later = extrapolate(state, 60 * kKeepAliveNs).device[0];
  EXPECT_NEAR(at_end, 0.1 + 0.1 * 0.04, 1e-12);
  EXPECT_NEAR(later, at_end + 0.1 * 0.02, 1e-9);
}

TEST(ProbeEncoder, SendsAtLeastOnceInEveryKeepAlivePeriod) {
  ProbeEncoder encoder;
  int sent = 0;
  for (std::int64_t ms = 0; ms < 1000; ++ms) sent += encoder.step(in_contact(0.001, {0, 0, 0}, ms * kMs)) ? 1 : 0;
  EXPECT_EQ(sent, 25);
}

TEST(ProbeEncoder, TheErrorStaysBelowTheJustNoticeableDifferenceWithoutLosses) {
  const Jnd jnd;
  for (const std::uint32_t seed : {1u, 2u, 3u}) {
    ProbeEncoder encoder;
    ProbeState last;
    std::size_t sent = 0;
    const std::vector<ProbeState> states = random_motion(20, seed);
    for (const ProbeState& state : states) {
      if (encoder.step(state)) {
        last = state;
        ++sent;
      }
      const ProbeView view = extrapolate(last, state.session_time_ns);
      const double force = std::hypot(state.force[0], state.force[1], state.force[2]);
      ASSERT_LE(distance(view.force, state.force), std::max(0.1 * force, 0.05) * (1 + 1e-12)) << "seed " << seed;
      ASSERT_LE(distance(view.device, state.device.position), 0.001 + 1e-12);
      ASSERT_EQ(last.status, state.status);
    }
    EXPECT_LT(sent, states.size() / 3) << "seed " << seed;
  }
}

TEST(ProbeEncoder, SendsAtOnceWhenContactBeginsOrEnds) {
  ProbeEncoder encoder;
  ProbeState free = in_contact(0, {0, 0, 0}, 0);
  free.status = kExact;
  free.object_id = 0;
  EXPECT_TRUE(encoder.step(free));
  free.session_time_ns = kMs;
  EXPECT_FALSE(encoder.step(free));
  EXPECT_TRUE(encoder.step(in_contact(1e-6, {0, 0, 0}, 2 * kMs)));
  free.session_time_ns = 3 * kMs;
  EXPECT_TRUE(encoder.step(free));
}

/// Share of cycles in which a receiver with random losses has an error above the just noticeable difference. The
/// encoder expects `expected_loss`.
double noticeable_share(const std::vector<ProbeState>& states, double loss, double expected_loss, std::size_t& sent) {
  CodingSettings settings;
  settings.loss = expected_loss;
  ProbeEncoder encoder{settings};
  std::mt19937 random{11};
  ProbeState last = states.front();
  std::size_t noticeable = 0;
  sent = 0;
  for (const ProbeState& state : states) {
    if (encoder.step(state)) {
      ++sent;
      if (std::uniform_real_distribution<>{}(random) >= loss) last = state;
    }
    noticeable +=
        settings.jnd.force_difference(state.force, extrapolate(last, state.session_time_ns).force) > 1 ? 1 : 0;
  }
  return static_cast<double>(noticeable) / static_cast<double>(states.size());
}

TEST(ProbeEncoder, SendsMoreStatesIfLossesAreExpected) {
  const std::vector<ProbeState> states = random_motion(60, 5);
  std::size_t sent_without = 0, sent_with = 0;
  const double without_expectation = noticeable_share(states, 0.3, 0, sent_without);
  const double with_expectation = noticeable_share(states, 0.3, 0.3, sent_with);
  EXPECT_GT(without_expectation, 0.1);
  EXPECT_LT(with_expectation, 0.1 * without_expectation + 0.02);
  EXPECT_GT(sent_with, sent_without);
  EXPECT_LT(sent_with, 6 * sent_without);
}

TEST(ProbeEncoder, SendsAProbeAtRestWhenSessionTimeStepsBack) {
  ProbeEncoder encoder;
  EXPECT_TRUE(encoder.step(in_contact(0.001, {0, 0, 0}, 60'000 * kMs)));
  EXPECT_FALSE(encoder.step(in_contact(0.001, {0, 0, 0}, 60'001 * kMs)));
  EXPECT_TRUE(encoder.step(in_contact(0.001, {0, 0, 0}, 5 * kMs)));
  EXPECT_FALSE(encoder.step(in_contact(0.001, {0, 0, 0}, 6 * kMs)));
}

}  // namespace
}  // namespace tactus::session
