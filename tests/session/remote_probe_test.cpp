#include "session/remote_probe.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <random>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

/// The state of a probe that presses on a surface with 0.5 to 1.5 N at 1 Hz.
ProbeState pressing(std::int64_t at_ms) {
  const double phase = 2 * M_PI * static_cast<double>(at_ms) * 1e-3;
  ProbeState state;
  state.origin.incarnation = 1;
  state.session_time_ns = at_ms * kMs;
  const double depth = 0.001 + 0.0005 * std::sin(phase);
  state.device.position = {0, 0, -depth};
  state.velocity = {0, 0, -0.0005 * 2 * M_PI * std::cos(phase)};
  state.stiffness = 1000;
  state.force = {0, 0, 1000 * depth};
  state.status = kInContact | kExact;
  return state;
}

/// Delivers the states of `pressing` over a link with a delay of 13 to 17 ms and shows the probe each millisecond. From
/// 1.5 s to 3 s the link also carries full-rate states.
class StreamChange : public ::testing::Test {
 protected:
  struct Sent {
    std::int64_t arrives_ns;
    ProbeState state;
    StateStream stream;
  };
  void run(const std::function<void(std::int64_t ms, const ShownProbe&)>& check) {
    std::mt19937 random{3};
    std::uniform_real_distribution<> jitter{-2, 2};
    ProbeEncoder encoder;
    std::uint32_t coded_sequence = 0, full_rate_sequence = 0;
    std::deque<Sent> links[2];
    for (std::int64_t ms = 0; ms < 5000; ++ms) {
      ProbeState state = pressing(ms);
      const auto arrives_ns = ms * kMs + static_cast<std::int64_t>((15 + jitter(random)) * 1e6);
      if (encoder.step(state)) {
        state.sequence = ++coded_sequence;
        links[0].push_back({arrives_ns, state, StateStream::kDeadbandCoded});
      }
      if (ms >= 1500 && ms < 3000) {
        state.sequence = ++full_rate_sequence;
        links[1].push_back({arrives_ns, state, StateStream::kFullRate});
      }
      for (auto& link : links)
        for (; !link.empty() && link.front().arrives_ns <= ms * kMs; link.pop_front())
          (void)probe_.on_state(link.front().state, link.front().stream, ms * kMs);
      check(ms, probe_.view_at(ms * kMs));
    }
  }
  RemoteProbe probe_;
};

TEST_F(StreamChange, TheShownForceDoesNotStepWhenTheStreamChanges) {
  const Jnd jnd;
  double last_force = 0, max_step = 0;
  run([&](std::int64_t ms, const ShownProbe& shown) {
    const double force = shown.view.force[2];
    if (ms > 1000) max_step = std::max(max_step, std::abs(force - last_force));
    last_force = force;
    if (ms < 1000) return;
    const double expected = pressing(0).force[2] + 0.5 * std::sin(2 * M_PI * static_cast<double>(shown.at_ns) * 1e-9);
    ASSERT_LE(std::abs(force - expected), 1.3 * std::max(0.1 * expected, jnd.force_floor)) << "at " << ms << " ms";
  });
  // The force itself changes by 3 mN in a millisecond. A new deadband-coded state adds at most the deadband, 0.15 N.
  EXPECT_LE(max_step, 0.155);
}

TEST_F(StreamChange, ShowsFullRateStatesWithLessDelayWhileTheyArrive) {
  std::int64_t coded_delay = 0, full_rate_delay = 0;
  run([&](std::int64_t ms, const ShownProbe&) {
    if (ms == 1400) {
      EXPECT_EQ(probe_.stream(), StateStream::kDeadbandCoded);
      coded_delay = probe_.delay_ns();
    }
    if (ms == 2900) {
      EXPECT_EQ(probe_.stream(), StateStream::kFullRate);
      full_rate_delay = probe_.delay_ns();
    }
    if (ms == 3100) {
      EXPECT_EQ(probe_.stream(), StateStream::kDeadbandCoded);
    }
  });
  EXPECT_GT(coded_delay, 15 * kMs);
  EXPECT_LT(full_rate_delay, coded_delay - 10 * kMs);
}

TEST(RemoteProbe, MeasuresTheShareOfLostDeadbandCodedStates) {
  RemoteProbe probe;
  std::mt19937 random{5};
  EXPECT_EQ(probe.lost_share(), 0);
  ProbeState state;
  state.origin.incarnation = 1;
  for (std::uint32_t i = 1; i <= 20000; ++i) {
    state.sequence = i;
    state.session_time_ns = i * 10 * kMs;
    if (std::uniform_real_distribution<>{}(random) >= 0.2)
      (void)probe.on_state(state, StateStream::kDeadbandCoded, state.session_time_ns);
  }
  EXPECT_NEAR(probe.lost_share(), 0.2, 0.1);
}

TEST(RemoteProbe, IgnoresStatesOfAnEarlierIncarnation) {
  RemoteProbe probe;
  ProbeState state;
  state.origin.incarnation = 7;
  state.sequence = 1;
  state.radius = 1;
  (void)probe.on_state(state, StateStream::kDeadbandCoded, 0);
  state.origin.incarnation = 6;
  state.sequence = 2;
  state.radius = 2;
  EXPECT_EQ(probe.on_state(state, StateStream::kDeadbandCoded, kMs), Admission::kImplausible);
  EXPECT_EQ(probe.view_at(2 * kMs).state.radius, 1);
}

ProbeState state_of(std::uint64_t participant, std::uint64_t incarnation, std::uint32_t sequence, std::int64_t ms) {
  ProbeState state;
  state.origin.participant = participant;
  state.origin.incarnation = incarnation;
  state.sequence = sequence;
  state.session_time_ns = ms * kMs;
  state.radius = static_cast<double>(ms);
  return state;
}

TEST(RemoteProbe, AcceptsStatesAfterOneImplausibleSequence) {
  for (const StateStream stream : {StateStream::kDeadbandCoded, StateStream::kFullRate}) {
    RemoteProbe probe;
    std::uint32_t sequence = 0;
    std::int64_t ms = 0;
    for (; ms < 100; ++ms) (void)probe.on_state(state_of(1, 1, ++sequence, ms), stream, ms * kMs);
    EXPECT_EQ(probe.on_state(state_of(1, 1, 4'000'000'000, ms), stream, ms * kMs), Admission::kImplausible);
    for (; ms < 1000; ++ms) (void)probe.on_state(state_of(1, 1, ++sequence, ms), stream, ms * kMs);
    EXPECT_NEAR(probe.view_at(ms * kMs).state.radius, static_cast<double>(ms), 10);
    EXPECT_FALSE(probe.view_at(ms * kMs).stale);
    EXPECT_LT(probe.lost_share(), 0.05);
  }
}

TEST(RemoteProbe, AcceptsStatesAfterOneImplausibleTime) {
  RemoteProbe probe;
  std::uint32_t sequence = 0;
  for (std::int64_t ms = 0; ms < 2000; ++ms) {
    ProbeState state = state_of(1, 1, ++sequence, ms);
    if (ms == 100) state.session_time_ns = INT64_MAX;
    (void)probe.on_state(state, StateStream::kDeadbandCoded, ms * kMs);
    if (ms < 110) continue;
    ASSERT_NEAR(probe.view_at(ms * kMs).state.radius, static_cast<double>(ms), 10) << "at " << ms << " ms";
  }
  EXPECT_TRUE(probe.view_at(5000 * kMs).stale) << "no state for three seconds";
}

TEST(RemoteProbe, FollowsAUserToAnHrtcWithASmallerIncarnation) {
  RemoteProbe probe;
  std::int64_t ms = 0;
  for (std::uint32_t i = 1; i <= 100; ++i, ++ms)
    (void)probe.on_state(state_of(8, 50, i, ms), StateStream::kDeadbandCoded, ms * kMs);
  for (std::uint32_t i = 1; i <= 100; ++i, ++ms)
    (void)probe.on_state(state_of(9, 20, i, ms), StateStream::kDeadbandCoded, ms * kMs);
  EXPECT_EQ(probe.view_at(ms * kMs).state.origin.participant, 9u);
  EXPECT_NEAR(probe.view_at(ms * kMs).state.radius, static_cast<double>(ms), 10);
}

TEST(RemoteProbe, AcceptsStatesAfterOneImplausibleIncarnation) {
  RemoteProbe probe;
  std::int64_t ms = 0;
  for (std::uint32_t i = 1; i <= 200; ++i, ++ms)
    (void)probe.on_state(state_of(8, i == 100 ? UINT64_MAX : 50, i, ms), StateStream::kDeadbandCoded, ms * kMs);
  EXPECT_EQ(probe.view_at(ms * kMs).state.origin.incarnation, 50u);
  EXPECT_NEAR(probe.view_at(ms * kMs).state.radius, static_cast<double>(ms), 10);
}

}  // namespace
}  // namespace tactus::session
