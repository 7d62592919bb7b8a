/// Host and HRTC far from each other, and over links that lose samples.
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

/// Skipped where network namespaces may not be made; scripts/test and CI may.
class FarTest : public SessionTest {
 protected:
  void SetUp() override {
    if (const std::string reason = netem::missing_privilege(); !reason.empty()) GTEST_SKIP() << reason;
  }
  [[nodiscard]] static std::vector<std::string> in(const netem::LinkedPair& pair, Side side,
                                                   const std::vector<std::string>& command) {
    std::vector<std::string> whole{"/sbin/ip", "netns", "exec", pair.name(side)};
    whole.insert(whole.end(), command.begin(), command.end());
    return whole;
  }
};

/// A round trip for the demand and the first of the base mesh, one for the rest of it; what makes host and HRTC find
/// each other's bulk ends happens before or meanwhile.
TEST_F(FarTest, TheBaseMeshIsThereTwoRoundTripsAfterTheCatalogue) {
  constexpr double kRoundTripUs = 100e3, kOwnUs = 100e3;
  const netem::LinkedPair pair{netem::parse_link("P0:delay=50")};
  const auto first_base = [&] {
    pair.enter_namespace(Side::kB);
    Observer observer{address("observer")};
    Process museum{in(pair, Side::kA, host("museum", models().organ))};
    EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.is_here("museum"); })) << museum.output();
    Process desk{in(pair, Side::kB, hrtc("desk"))};
    const auto published = [](const Seen& seen) { return seen.figure("desk", session::figures::kFirstBase) > 0; };
    EXPECT_TRUE(observer.until(published)) << desk.output();
    return observer.seen().figure("desk", session::figures::kFirstBase);
  };
  const double us = std::async(std::launch::async, first_base).get();
  EXPECT_LT(us, 2 * kRoundTripUs + kOwnUs);
}

/// Each beat of the roster counts for itself: one that is lost holds none back.
TEST_F(FarTest, NobodyIsGoneWhereSamplesGetLost) {
  const netem::LinkedPair pair{netem::parse_link("P0:delay=1:loss=10")};
  Process museum{in(pair, Side::kA, host("museum", models().sphere))};
  Process desk{in(pair, Side::kB, hrtc("desk", {"--wait-host", "20"}))};
  ASSERT_TRUE(desk.wait_for_line("host 'museum' joined")) << desk.output();
  ASSERT_TRUE(museum.wait_for_line("HRTC 'desk' joined")) << museum.output();
  // That nothing happens takes time: with reliable readers somebody was gone every 1.7 s, at half this loss.
  std::this_thread::sleep_for(4s);
  EXPECT_THAT(desk.output(), Not(HasSubstr("is gone")));
  EXPECT_THAT(museum.output(), Not(HasSubstr("is gone")));
}

}  // namespace
}  // namespace tactus::e2e
