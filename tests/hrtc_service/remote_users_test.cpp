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

TEST(RemoteUsers, OmitsALossThatAFullLinkCauses) {
  RemoteUsers users{0x11};
  session::Metrics metrics;
  metrics.origin.participant = 0x22;
  for (const double share : {0.3, 0.5, -1.0, 0.2}) {
    metrics.figures = {{session::figures::kLostOf + std::string{"0000000000000011"}, share}};
    users.on_metrics(metrics, 0);
    users.tick(0);
    EXPECT_EQ(users.loss(), share > 0 && share < 0.4 ? share : 0);
  }
}

/// Ann, a user of HRTC 1, and users of HRTCs 2 and 3 at one object. Each millisecond, the other HRTCs send a state.
class CollaboratingUsers : public ::testing::Test {
 protected:
  static constexpr std::uint64_t kAnn = 11;

  CollaboratingUsers() {
    session::CatalogueEntry cube;
    cube.object_id = 100;
    cube.summary.bounds_min = {-1, -1, -1};
    cube.summary.bounds_max = {1, 1, 1};
    users_.on_catalogue(cube);
    send(100, {1, 1});
    users_.on_peers(100, true);
  }
  /// `on_time`: of how many states one arrives, for each of the two HRTCs.
  void send(int ms, const std::array<int, 2>& on_time) {
    for (int i = 0; i < ms; ++i, now_ += kMs) {
      ++sequence_;
      for (std::uint64_t other = 0; other < 2; ++other) {
        session::ProbeState state = state_of(2 + other, 12 + other, 0);
        state.sequence = sequence_;
        state.session_time_ns = now_;
        if (sequence_ % static_cast<unsigned>(on_time[other]) == 0)
          users_.on_state(state, session::StateStream::kFullRate, now_, now_);
      }
      if (i % 20 != 0) continue;
      users_.on_own_probe(kAnn, {}, now_);
      users_.tick(now_);
    }
  }

  RemoteUsers users_{1};
  std::int64_t now_ = 1000 * kMs;
  std::uint32_t sequence_ = 0;
};

TEST_F(CollaboratingUsers, HaveNoGroupForATimeIfAllFullRateStatesAreLate) {
  ASSERT_EQ(users_.group_of(kAnn), 100u);
  send(2000, {3, 4});
  EXPECT_TRUE(users_.is_paused());
  EXPECT_EQ(users_.group_of(kAnn), 0u);
  EXPECT_TRUE(users_.losses().empty()) << "the other HRTCs are not the cause";
}

TEST_F(CollaboratingUsers, HaveNoGroupAlsoIfTheHeartbeatsOfTheOthersAreLost) {
  for (int i = 0; i < 20; ++i) {
    send(100, {3, 4});
    for (const std::uint64_t other : {2, 3}) users_.on_hrtc_gone(other);
  }
  EXPECT_TRUE(users_.is_paused());
}

TEST_F(CollaboratingUsers, ReportTheOneWhoseFullRateStatesAreLate) {
  send(2000, {1, 4});
  EXPECT_FALSE(users_.is_paused());
  EXPECT_EQ(users_.group_of(kAnn), 100u);
  session::Metrics report;
  report.origin.participant = 1;
  report.figures = users_.losses();
  ASSERT_EQ(report.figures.size(), 1u);
  EXPECT_EQ(report.figures[0].name, "lost.0000000000000003.full_rate");
  EXPECT_NEAR(report.figures[0].value, 0.75, 0.01);

  RemoteUsers reported{3}, other{2};
  for (RemoteUsers* const users : {&reported, &other}) {
    users->on_metrics(report, now_);
    users->tick(now_);
  }
  EXPECT_TRUE(reported.is_paused());
  EXPECT_FALSE(other.is_paused());
}

}  // namespace
}  // namespace tactus::hrtc_service
