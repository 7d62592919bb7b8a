/// An HRTC whose network part is killed, suspended or hangs. The servo goes on, and a new gateway continues with it.
#include <algorithm>
#include <cmath>
#include <map>
#include <thread>

#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"
#include "trace/flight_file.hpp"

namespace tactus::e2e {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
using Seen = Observer::Seen;
using testing::HasSubstr;
using testing::Not;

constexpr char kTwoUsersTouch[] = R"(name: two hold
duration: 3600
users:
  - name: ann
    script: [{approach: {object: "#1", direction: [0, 0, 1], speed: 0.2}}, {hold: {seconds: 3500, force: 1}}]
  - name: bob
    script: [{approach: {object: "#1", direction: [0, 1, 0], speed: 0.2}}, {hold: {seconds: 3500, force: 1}}]
)";

class GatewayTest : public SessionTest {
 protected:
  static constexpr double kMaxChange = 0.05;  // N, of a force of 1 N

  /// Returns the process id of the gateway that the HRTC has started, or 0.
  [[nodiscard]] static pid_t gateway_of(const Process& hrtc) {
    const std::vector<pid_t> pids = hrtc.pids();
    return pids.size() == 2 ? pids[1] : 0;
  }
  /// Waits until both users have exact contact in states of a gateway with another incarnation than `former`. Returns
  /// false after the watchdog.
  [[nodiscard]] static bool both_touch(Observer& observer, std::uint64_t former = 0) {
    observer.forget_states();
    return observer.until([&](const Seen& seen) {
      for (const char* name : {"ann", "bob"}) {
        const StateCounts user = seen.user(name);
        if (user.exact == 0 || user.last.origin.incarnation == former) return false;
      }
      return true;
    });
  }

  struct Cycle {
    std::int64_t time_ns = 0;
    std::array<double, 2> forces{};  // N, of the two users
  };
  /// Returns the cycles that the servo has recorded.
  [[nodiscard]] static std::vector<Cycle> read_recording(const std::string& file) {
    std::map<std::uint64_t, Cycle> cycles;  // by number
    trace::FlightFileReader reader{file};
    for (trace::FlightMessage message; reader.next(message);) {
      if (const auto* touch = std::get_if<trace::FlightTouch>(&message)) cycles[touch->cycle].time_ns = touch->time_ns;
      const auto* probe = std::get_if<trace::FlightProbe>(&message);
      if (probe != nullptr && probe->probe < 2)
        cycles[probe->cycle].forces[probe->probe] = std::hypot(probe->force[0], probe->force[1], probe->force[2]);
    }
    std::vector<Cycle> all;
    for (const auto& [number, cycle] : cycles) all.push_back(cycle);
    return all;
  }

  /// Ends gateways by each of these signals while two users touch a fixed object. The forces may not change.
  void kill_gateways(int kills) {
    Observer observer{address("observer")};
    Process museum{host("museum", models().sphere)};
    Process desk{hrtc("desk", {"--flight-file", path("flight.mcap"), "--flight-recorder", "3600", "--users", "2"})};
    Process users{sim(kTwoUsersTouch)};
    ASSERT_TRUE(both_touch(observer)) << users.output() << desk.output();
    std::this_thread::sleep_for(Seconds{1});  // until the hands rest
    const auto rested = Clock::now();
    std::vector<double> pauses;  // s, between a kill and the first states of both users
    for (int i = 0; i < kills; ++i) {
      constexpr int kSignals[] = {SIGKILL, SIGSEGV, SIGSTOP, SIGABRT};
      const int number = kSignals[i % std::size(kSignals)];
      SCOPED_TRACE("kill " + std::to_string(i) + " by signal " + std::to_string(number));
      const pid_t gateway = gateway_of(desk);
      ASSERT_GT(gateway, 0);
      const std::uint64_t incarnation = observer.seen().user("ann").last.origin.incarnation;
      ::kill(gateway, number);
      if (number == SIGSTOP) {
        std::this_thread::sleep_for(Seconds{2});
        ::kill(gateway, SIGCONT);
      }
      const auto began = Clock::now();
      ASSERT_TRUE(both_touch(observer, number == SIGSTOP ? 0 : incarnation)) << desk.output();
      pauses.push_back(Seconds{Clock::now() - began}.count());
    }
    const double touched = Seconds{Clock::now() - rested}.count();
    desk.signal(SIGTERM);
    ASSERT_TRUE(exits_with(0, desk));
    EXPECT_THAT(desk.output(), HasSubstr("the network part (tactus-gateway) was killed by SIGKILL; it starts again"));
    std::sort(pauses.begin(), pauses.end());
    EXPECT_LT(pauses.back(), 3) << "s, the longest time without states";
    const std::vector<Cycle> cycles = read_recording(path("flight.mcap"));
    ASSERT_GT(cycles.size(), 2000u);
    for (const double force : cycles.back().forces) EXPECT_NEAR(force, 1, 0.1) << "N, with which the hands press";
    const auto differs = [&](const Cycle& cycle) {
      for (int user = 0; user < 2; ++user)
        if (std::abs(cycle.forces[user] - cycles.back().forces[user]) > kMaxChange) return true;
      return false;
    };
    const auto changed = std::find_if(cycles.rbegin(), cycles.rend(), differs);
    ASSERT_NE(changed, cycles.rend()) << "the hands pressed from the first cycle on";
    EXPECT_GT(static_cast<double>(cycles.back().time_ns - changed->time_ns) * 1e-9, touched)
        << "s, in which the forces did not change";
  }
};

TEST_F(GatewayTest, IsReplacedWithoutAChangeOfTheForces) { kill_gateways(3); }

using HundredsOfGateways = GatewayTest;
TEST_F(HundredsOfGateways, AreReplacedWithoutAChangeOfTheForces) { kill_gateways(400); }

TEST_F(GatewayTest, WithoutItAFixedObjectIsTouchedForTheGivenTime) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--flight-file", path("flight.mcap"), "--gateway-patience", "0.5"})};
  Process users{sim(kTwoUsersTouch)};
  ASSERT_TRUE(both_touch(observer)) << users.output() << desk.output();
  std::this_thread::sleep_for(Seconds{1});
  const pid_t gateway = gateway_of(desk);
  ::kill(gateway, SIGSTOP);
  std::this_thread::sleep_for(Seconds{1.5});
  ::kill(gateway, SIGCONT);
  ASSERT_TRUE(both_touch(observer)) << desk.output();
  std::this_thread::sleep_for(Seconds{1});
  desk.signal(SIGTERM);
  ASSERT_TRUE(exits_with(0, desk));
  const std::vector<Cycle> cycles = read_recording(path("flight.mcap"));
  const auto is_zero = [](const Cycle& cycle) { return cycle.forces[0] == 0 && cycle.forces[1] == 0; };
  const auto has_forces = [](const Cycle& cycle) { return cycle.forces[0] > 0.5 && cycle.forces[1] > 0.5; };
  const auto touched = std::find_if(cycles.begin(), cycles.end(), has_forces);
  const auto ended = std::find_if(touched, cycles.end(), is_zero);
  ASSERT_NE(ended, cycles.end()) << "the forces stayed";
  EXPECT_NE(std::find_if(ended, cycles.end(), has_forces), cycles.end()) << "the forces do not return";
}

TEST_F(GatewayTest, LeavesTheSessionIfTheServoIsKilled) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk"); })) << desk.output();
  desk.signal(SIGKILL);
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.has_left("desk"); }));
  EXPECT_TRUE(exits_with(128 + SIGKILL, desk));
}

TEST_F(GatewayTest, IsNotStartedAgainIfItIsKilledBeforeItHasJoined) {
  Process desk{hrtc("desk")};
  pid_t gateway = 0;
  while ((gateway = gateway_of(desk)) == 0 && desk.running()) std::this_thread::yield();
  ::kill(gateway, SIGKILL);
  EXPECT_TRUE(exits_with(1, desk));
  EXPECT_THAT(desk.output(), HasSubstr("was killed by SIGKILL before it had joined the session"));
}

TEST_F(GatewayTest, IsAPartOfTactusHrtcAndNotStartedAlone) {
  Process alone{program("gateway", {"--session", "lab"})};
  EXPECT_TRUE(exits_with(2, alone));
  EXPECT_THAT(alone.output(), HasSubstr("tactus-gateway is a part of tactus-hrtc, which starts it"));
}

TEST_F(GatewayTest, MayRunInTheProcessOfTheServo) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--one-process", "--log", path("desk.log")})};
  Process users{sim(kTwoUsersTouch)};
  ASSERT_TRUE(both_touch(observer)) << users.output() << desk.output();
  EXPECT_EQ(gateway_of(desk), 0);
  desk.signal(SIGTERM);
  EXPECT_TRUE(exits_with(0, desk));
  Process audit{program("mesh", {"audit", path("desk.log"), models().sphere})};
  EXPECT_TRUE(exits_with(0, audit)) << audit.output();
}

TEST_F(GatewayTest, TheServoHasNoDdsNoImporterAndNoXmlParser) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk", {"--device", "ann=" TACTUS_EXAMPLE_WEIGHT ",0.3"})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk"); })) << desk.output();
  const std::string servo = test_support::read_bytes("/proc/" + std::to_string(desk.pid()) + "/maps");
  const std::string gateway = test_support::read_bytes("/proc/" + std::to_string(gateway_of(desk)) + "/maps");
  EXPECT_THAT(gateway, HasSubstr("libfastrtps")) << "the search finds it where it is";
  EXPECT_THAT(servo, HasSubstr("weight"));
  for (const char* library : {"fastrtps", "fastdds", "fastcdr", "assimp", "tinyxml"})
    EXPECT_THAT(servo, Not(HasSubstr(library)));
}

}  // namespace
}  // namespace tactus::e2e
