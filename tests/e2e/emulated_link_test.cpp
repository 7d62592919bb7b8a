/// A host and an HRTC whose emulated link has a delay or loses samples.
#include <future>
#include <thread>

#include "netem/pair.hpp"
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;
using netem::Side;
using testing::HasSubstr;
using testing::Not;

/// Skipped if this process may not create network namespaces. scripts/test and CI may create them.
class EmulatedLinkTest : public SessionTest {
 protected:
  void SetUp() override {
    if (const std::string reason = netem::missing_privilege(); !reason.empty()) GTEST_SKIP() << reason;
  }
  [[nodiscard]] static std::vector<std::string> in_namespace(const netem::LinkedPair& pair, Side side,
                                                             const std::vector<std::string>& command) {
    std::vector<std::string> full_command{"/sbin/ip", "netns", "exec", pair.name(side)};
    full_command.insert(full_command.end(), command.begin(), command.end());
    return full_command;
  }
};

/// The first round trip is for the demand and the first chunks of the base mesh, the second for the other chunks. The
/// discovery of the bulk endpoints must not need a further round trip.
TEST_F(EmulatedLinkTest, TheBaseMeshArrivesTwoRoundTripsAfterTheCatalogue) {
  constexpr double kRoundTripUs = 100e3, kProcessingUs = 100e3;
  const netem::LinkedPair pair{netem::parse_link("P0:delay=50")};
  const auto measure_first_base = [&] {
    pair.enter_namespace(Side::kB);
    Observer observer{address("observer")};
    Process museum{in_namespace(pair, Side::kA, host("museum", models().organ))};
    EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("museum"); })) << museum.output();
    Process desk{in_namespace(pair, Side::kB, hrtc("desk"))};
    const auto published = [](const Seen& seen) { return seen.figure("desk", session::figures::kFirstBase) > 0; };
    EXPECT_TRUE(observer.until(published)) << desk.output();
    return observer.seen().figure("desk", session::figures::kFirstBase);
  };
  const double first_base_us = std::async(std::launch::async, measure_first_base).get();
  EXPECT_LT(first_base_us, 2 * kRoundTripUs + kProcessingUs);
}

/// Readers of the roster are best effort, so that a lost heartbeat does not delay the heartbeats after it.
TEST_F(EmulatedLinkTest, LostSamplesMakeNoParticipantAppearGone) {
  const netem::LinkedPair pair{netem::parse_link("P0:delay=1:loss=10")};
  Process museum{in_namespace(pair, Side::kA, host("museum", models().sphere))};
  Process desk{in_namespace(pair, Side::kB, hrtc("desk", {"--wait-host", "20"}))};
  ASSERT_TRUE(desk.wait_for_line("host 'museum' joined")) << desk.output();
  ASSERT_TRUE(museum.wait_for_line("HRTC 'desk' joined")) << museum.output();
  // With reliable readers and 5 % loss, a participant appeared gone every 1.7 s, so twice in this time. The test waits
  // for events that must not happen; no event ends it.
  std::this_thread::sleep_for(4s);
  EXPECT_THAT(desk.output(), Not(HasSubstr("is silent")));
  EXPECT_THAT(museum.output(), Not(HasSubstr("is silent")));
}

}  // namespace
}  // namespace tactus::e2e
