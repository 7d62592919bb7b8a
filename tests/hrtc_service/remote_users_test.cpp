#include "hrtc_service/remote_users.hpp"

#include <gtest/gtest.h>

#include "hrtc_service/servo/touch_object.hpp"
#include "tests/support/constants.hpp"

namespace tactus::hrtc_service {
namespace {

session::ProbeState state_of(std::uint64_t participant, std::uint64_t user, std::uint32_t probe) {
  session::ProbeState state;
  state.origin = {kSession, participant, 1, 0};
  state.user_id = user;
  state.probe = probe;
  state.sequence = 1;
  return state;
}

/// Passes a state that arrives at `now_ns` to `users`.
void receive(RemoteUsers& users, const session::ProbeState& state, std::int64_t now_ns = 0) {
  users.on_state(state, session::StateStream::kDeadbandCoded, now_ns, now_ns);
}

double number_of_probes(const RemoteUsers& users) {
  std::vector<session::Figure> figures;
  users.add_figures(figures);
  for (const session::Figure& figure : figures)
    if (figure.name == session::figures::kRemoteProbes) return figure.value;
  return -1;
}

TEST(RemoteUsers, RefusesProbeNumbersThatNoHrtcHas) {
  RemoteUsers users{kHrtc};
  receive(users, state_of(kOtherHrtc, 1, kMaxProbes - 1));
  EXPECT_EQ(users.implausible(), 0u);
  for (std::uint32_t probe = kMaxProbes; probe < 1000; ++probe) receive(users, state_of(kOtherHrtc, 1, probe));
  EXPECT_EQ(number_of_probes(users), 1);
  EXPECT_EQ(users.implausible(), 1000 - kMaxProbes);
}

TEST(RemoteUsers, AnHrtcHasABoundedNumberOfProbes) {
  RemoteUsers users{kHrtc};
  for (std::uint64_t user = 1; user <= 1000; ++user) receive(users, state_of(kOtherHrtc, user, user % kMaxProbes));
  EXPECT_EQ(number_of_probes(users), kMaxProbes);
  receive(users, state_of(kOtherHrtc + 1, 2000, 0));
  EXPECT_EQ(number_of_probes(users), kMaxProbes + 1) << "another HRTC still has room";

  users.tick(301 * kMs);
  receive(users, state_of(kOtherHrtc, 2001, 0), 301 * kMs);
  EXPECT_EQ(number_of_probes(users), 1) << "probes without states were removed";
}

TEST(RemoteUsers, AllHrtcsTogetherHaveABoundedNumberOfProbes) {
  RemoteUsers users{kHrtc};
  for (std::uint64_t hrtc = 100; hrtc < 1100; ++hrtc) receive(users, state_of(hrtc, hrtc, 0));
  EXPECT_EQ(number_of_probes(users), 256);
}

TEST(RemoteUsers, ReturnsALossReportUntilItExpires) {
  RemoteUsers users{0x11};
  session::Metrics metrics;
  metrics.origin.participant = 0x22;
  metrics.figures = {{session::figures::kLostOf + std::string{"0000000000000011"}, 0.25}};
  users.on_metrics(metrics, 0);
  users.tick(3000 * kMs);
  EXPECT_EQ(users.loss(), 0.25);
  users.tick(3001 * kMs);
  EXPECT_EQ(users.loss(), 0);
}

}  // namespace
}  // namespace tactus::hrtc_service
