/// A host and an HRTC whose emulated link has a delay or loses samples.
#include <cstdio>
#include <cstdlib>
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
    full_command.emplace_back("--plain");
    return full_command;
  }
  [[nodiscard]] double first_base_us();
};

/// Returns when the HRTC had its first base mesh, us after the catalogue, if every message needs 50 ms.
double EmulatedLinkTest::first_base_us() {
  const netem::LinkedPair pair{netem::parse_link("P0:delay=50")};
  pair.enter_namespace(Side::kB);
  wire::SessionAddress as_observer = address("observer");
  as_observer.plain = true;
  Observer observer{as_observer};
  Process museum{in_namespace(pair, Side::kA, host("museum", models().organ))};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("museum"); })) << museum.output();
  Process desk{in_namespace(pair, Side::kB, hrtc("desk"))};
  const auto published = [](const Seen& seen) { return seen.figure("desk", session::figures::kFirstBase) > 0; };
  EXPECT_TRUE(observer.until(published)) << desk.output();
  return observer.seen().figure("desk", session::figures::kFirstBase);
}

/// The first round trip is for the demand and the first chunks of the base mesh, the second for the other chunks. The
/// discovery of the bulk endpoints must not need a further round trip. The observer is in a process of its own, because
/// Fast DDS 3.1 reads the addresses of the network once in each process.
TEST_F(EmulatedLinkTest, TheBaseMeshArrivesTwoRoundTripsAfterTheCatalogue) {
  constexpr double kRoundTripUs = 100e3, kProcessingUs = 100e3;
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto measure = [this] {
    const double us = first_base_us();
    std::fprintf(stderr, "first base mesh after %g us\n", us);
    std::exit(us > 0 && us < 2 * kRoundTripUs + kProcessingUs ? 0 : 1);
  };
  EXPECT_EXIT(measure(), testing::ExitedWithCode(0), "");
}

class BothMedia : public EmulatedLinkTest, public testing::WithParamInterface<const char*> {};
INSTANTIATE_TEST_SUITE_P(Links, BothMedia, testing::Values("veth", "P0"));

TEST_P(BothMedia, LetProgramsOfASessionFindEachOther) {
  const netem::LinkedPair pair{netem::parse_link(GetParam())};
  Process museum{in_namespace(pair, Side::kA, host("museum", models().sphere))};
  Process desk{in_namespace(pair, Side::kB, hrtc("desk", {"--wait-host", "20"}))};
  EXPECT_TRUE(desk.wait_for_line("host 'museum' joined")) << desk.output();
  EXPECT_TRUE(museum.wait_for_line("HRTC 'desk' joined")) << museum.output();
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
