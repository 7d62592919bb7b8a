/// An HRTC whose gateway is killed or suspended. The servo goes on, and a new gateway continues with it.
#include <fcntl.h>
#include <linux/input.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <thread>

#include "realtime/process.hpp"
#include "tests/devices/haply_service.hpp"
#include "tests/e2e/session_test.hpp"
#include "trace/flight_file.hpp"

namespace tactus::e2e {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
using Seen = Observer::Seen;
using testing::AnyOf;
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

constexpr char kOneUserTouches[] = R"(name: one touches
duration: 3600
users:
  - name: cid
    script: [{approach: {object: "#1", direction: [0, 1, 0], speed: 0.2}}, {hold: {seconds: 3500, force: 1}}]
)";

/// A crate of 12 cm that a hand can move, and one that is fixed.
constexpr char kCrateAndTable[] = R"(objects:
  - {model: crate.spm, position: [0, 0, 0.06], material: {stiffness: 1000}, body: {mass: 0.8, friction: 0.6}}
  - {name: table, model: crate.spm, position: [0.3, 0, 0.06], material: {stiffness: 1000}}
)";
constexpr double kPressed = 0.2;  // N, min force of a hand that presses 2 mm deep

class GatewayTest : public SessionTest {
 protected:
  static constexpr double kMaxChange = 0.001;  // N

  /// Returns the process id of the gateway that the HRTC has started, or 0.
  [[nodiscard]] static pid_t gateway_of(const Process& hrtc) { return hrtc.child("tactus-gateway"); }
  /// Waits until these users have exact contact in states of a gateway with another incarnation than `former`. Returns
  /// false after the watchdog.
  [[nodiscard]] static bool touch(const std::vector<std::string>& users, Observer& observer, std::uint64_t former = 0) {
    observer.forget_states();
    return observer.until([&](const Seen& seen) {
      for (const std::string& name : users) {
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
  [[nodiscard]] static double norm(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }
  /// Returns the cycles that the servo has recorded.
  [[nodiscard]] static std::vector<Cycle> read_recording(const std::string& file) {
    std::map<std::uint64_t, Cycle> cycles;  // by number
    trace::FlightFileReader reader{file};
    for (trace::FlightMessage message; reader.next(message);) {
      if (const auto* touch = std::get_if<trace::FlightTouch>(&message)) cycles[touch->cycle].time_ns = touch->time_ns;
      const auto* probe = std::get_if<trace::FlightProbe>(&message);
      if (probe != nullptr && probe->probe < 2) cycles[probe->cycle].forces[probe->probe] = norm(probe->force);
    }
    std::vector<Cycle> all;
    for (const auto& [number, cycle] : cycles) all.push_back(cycle);
    return all;
  }

  /// Ends gateways by each of these signals. Meanwhile two replayed hands of the HRTC rest on a fixed object, and a user
  /// at a client presses on it. The forces on the replayed hands may not change.
  void kill_gateways(int kills) {
    Observer observer{address("observer")};
    Process museum{host("museum", models().sphere)};
    // The tip comes down on the sphere, and rests half a millimetre deep. The radii are 3 mm and 50 mm.
    test_support::write_bytes(path("touch.csv"), "0,0,0,0.1\n0.5,0,0,0.0525\n");
    Process desk{hrtc("desk", {"--flight-file", path("flight.mcap"), "--flight-recorder", "3600", "--users", "3",
                               "--replay", "ann=" + path("touch.csv"), "--replay", "bob=" + path("touch.csv")})};
    Process users{sim(kOneUserTouches)};
    const auto rests = [](const Seen& seen, const char* user) {
      const session::ProbeState state = seen.user(user).last;
      return state.force[2] > 0.1 && std::abs(state.velocity[2]) < 1e-4;
    };
    ASSERT_TRUE(observer.until([&](const Seen& seen) {
      return rests(seen, "ann") && rests(seen, "bob") && seen.user("cid").exact > 0;
    })) << users.output()
        << desk.output();
    const std::vector<std::string> kAll{"ann", "bob", "cid"};
    const std::int64_t rested_ns = realtime::monotonic_ns();
    std::vector<double> pauses;  // s, between a kill and the first states of both users
    for (int i = 0; i < kills; ++i) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // a sanitizer catches SIGSEGV
      constexpr int kSignals[] = {SIGKILL, SIGABRT, SIGSTOP};
#else
      constexpr int kSignals[] = {SIGKILL, SIGSEGV, SIGSTOP, SIGABRT};
#endif
      const int number = kSignals[i % std::size(kSignals)];
      SCOPED_TRACE("kill " + std::to_string(i) + " by signal " + std::to_string(number));
      const pid_t gateway = gateway_of(desk);
      ASSERT_GT(gateway, 0);
      const std::uint64_t incarnation = observer.seen().user("ann").last.origin.incarnation;
      ::kill(gateway, number);
      if (number == SIGSTOP) {
        std::this_thread::sleep_for(Seconds{2});  // the suspension under test
        ::kill(gateway, SIGCONT);
      }
      const auto began = Clock::now();
      ASSERT_TRUE(touch(kAll, observer, number == SIGSTOP ? 0 : incarnation)) << desk.output();
      pauses.push_back(Seconds{Clock::now() - began}.count());
    }
    desk.signal(SIGTERM);
    ASSERT_TRUE(exits_with(0, desk));
    EXPECT_THAT(desk.output(), HasSubstr("the gateway (tactus-gateway) was killed by SIGKILL; it starts again"));
    std::sort(pauses.begin(), pauses.end());
    EXPECT_LT(pauses[pauses.size() * 99 / 100], 5) << "s, p99 of the time without states, beside other tests";
    const std::vector<Cycle> cycles = read_recording(path("flight.mcap"));
    ASSERT_GT(cycles.size(), 2000u);
    const auto rested =
        std::find_if(cycles.begin(), cycles.end(), [&](const Cycle& cycle) { return cycle.time_ns >= rested_ns; });
    ASSERT_NE(rested, cycles.end());
    const std::array<double, 2> forces = std::prev(cycles.end(), 100)->forces;  // before those that end the HRTC
    EXPECT_GT(forces[0], 0.1);
    const auto differs = [&](const Cycle& cycle) {
      return std::abs(cycle.forces[0] - forces[0]) > kMaxChange || std::abs(cycle.forces[1] - forces[1]) > kMaxChange;
    };
    const auto changed = std::find_if(rested, cycles.end() - 100, differs);
    EXPECT_EQ(changed, cycles.end() - 100)
        << "a force changed to " << changed->forces[0] << " N after a gateway was killed";
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
  const auto rests = [](const Seen& seen, const char* user) {
    const session::ProbeState state = seen.user(user).last;
    return std::abs(norm(state.force) - 1) < 0.1 && norm(state.velocity) < 1e-3;
  };
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return rests(seen, "ann") && rests(seen, "bob"); }))
      << users.output() << desk.output();
  const pid_t gateway = gateway_of(desk);
  ASSERT_GT(gateway, 0);
  const std::int64_t stopped_ns = realtime::monotonic_ns();
  ::kill(gateway, SIGSTOP);
  std::this_thread::sleep_for(Seconds{2});  // the suspension under test
  const std::int64_t continued_ns = realtime::monotonic_ns();
  ::kill(gateway, SIGCONT);
  ASSERT_TRUE(touch({"ann", "bob"}, observer)) << desk.output();
  std::this_thread::sleep_for(Seconds{1});  // the recording gets the cycles in which the forces return
  desk.signal(SIGTERM);
  ASSERT_TRUE(exits_with(0, desk));
  const std::vector<Cycle> cycles = read_recording(path("flight.mcap"));
  const auto has_forces = [](const Cycle& cycle) { return cycle.forces[0] > 0.5 && cycle.forces[1] > 0.5; };
  const auto stopped =
      std::find_if(cycles.begin(), cycles.end(), [&](const Cycle& cycle) { return cycle.time_ns >= stopped_ns; });
  const auto first_at = [&](std::int64_t time_ns) {
    return std::find_if(stopped, cycles.end(), [&](const Cycle& cycle) { return cycle.time_ns >= time_ns; });
  };
  const auto continued = first_at(continued_ns), patience_ended = first_at(stopped_ns + 500'000'000);
  // On a busy machine, the poses of a late cycle can be stale, and its forces zero. So the last force counts, not the
  // first cycle without one, of which there may be few.
  const auto lacks_force = [](const Cycle& cycle) { return cycle.forces == std::array<double, 2>{}; };
  EXPECT_LE(20 * std::count_if(stopped, patience_ended, lacks_force), patience_ended - stopped);
  const auto last =
      std::find_if_not(std::make_reverse_iterator(continued), std::make_reverse_iterator(stopped), lacks_force);
  ASSERT_NE(last, std::make_reverse_iterator(stopped)) << "the forces ended at once";
  // Half a second of patience, and then half a second in which the force decreases.
  const double seconds = static_cast<double>(last->time_ns - stopped_ns) * 1e-9;
  EXPECT_GT(seconds, 0.5);
  EXPECT_LT(seconds, 1.5) << "the forces stayed";
  EXPECT_NE(std::find_if(continued, cycles.end(), has_forces), cycles.end()) << "the forces do not return";
}

TEST_F(GatewayTest, LeavesTheSessionIfTheServoIsKilledAndTheDriverEnds) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk", {"--device", "ann=" TACTUS_EXAMPLE_WEIGHT ",0.3"})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk"); })) << desk.output();
  ASSERT_GT(desk.child("tactus-device"), 0);
  desk.signal(SIGKILL);
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.has_left("desk"); }));
  EXPECT_TRUE(exits_with(128 + SIGKILL, desk));
}

TEST_F(GatewayTest, IsNotStartedAgainIfItIsKilledBeforeItHasJoined) {
  Process desk{hrtc("desk")};
  pid_t gateway = 0;
  while ((gateway = gateway_of(desk)) == 0 && desk.running()) std::this_thread::yield();
  ASSERT_GT(gateway, 0) << desk.output();
  ::kill(gateway, SIGKILL);
  EXPECT_TRUE(exits_with(1, desk));
  EXPECT_THAT(desk.output(), HasSubstr("the gateway (tactus-gateway) was killed by SIGKILL at the start"));
}

TEST_F(GatewayTest, IsTheFirstProcessThatTheSystemEndsIfMemoryIsShort) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk"); })) << desk.output();
  const auto score_of = [](pid_t pid) {
    return test_support::read_bytes("/proc/" + std::to_string(pid) + "/oom_score_adj");
  };
  // A process that has all memory has a score of 1000 without this value.
  EXPECT_EQ(score_of(gateway_of(desk)), "1000\n");
  EXPECT_EQ(score_of(desk.pid()), score_of(::getpid()));
}

TEST_F(GatewayTest, IsAPartOfTactusHrtcAndNotStartedAlone) {
  Process alone{program("gateway", {"--session", "lab"})};
  EXPECT_TRUE(exits_with(2, alone));
  EXPECT_THAT(alone.output(), HasSubstr("tactus-gateway is a part of tactus-hrtc, which starts it"));
}

TEST_F(GatewayTest, EndsWithTheSessionAfterTheServo) {
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--log", path("desk.log")})};
  Process users{in_session("sim", {"--scenario", "touch", "--seconds", "4"})};
  EXPECT_TRUE(exits_with(0, users)) << users.output();
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_THAT(desk.output(), Not(HasSubstr("entries were dropped")));
  Process audit{program("mesh", {"audit", path("desk.log"), models().sphere})};
  EXPECT_TRUE(exits_with(0, audit)) << audit.output();
}

TEST_F(GatewayTest, MayRunInTheProcessOfTheServo) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--one-process", "--log", path("desk.log")})};
  Process users{sim(kTwoUsersTouch)};
  ASSERT_TRUE(touch({"ann", "bob"}, observer)) << users.output() << desk.output();
  EXPECT_EQ(gateway_of(desk), 0);
  EXPECT_EQ(test_support::read_bytes("/proc/" + std::to_string(desk.pid()) + "/comm"), "tactus-hrtc\n")
      << "a local stop searches for this name";
  desk.signal(SIGTERM);
  EXPECT_TRUE(exits_with(0, desk));
  Process audit{program("mesh", {"audit", path("desk.log"), models().sphere})};
  EXPECT_TRUE(exits_with(0, audit)) << audit.output();
}

TEST_F(GatewayTest, WithoutItAMovableObjectExertsNoForceAfter60Ms) {
  const std::string crate = path("crate.spm");
  ASSERT_EQ(Process{program("mesh", {"generate", "box", "--faces", "1200", path("crate.ply")})}.wait(), 0);
  ASSERT_EQ(Process{program("mesh", {"build", path("crate.ply"), crate, "--size", "0.12"})}.wait(), 0);
  write("store.yaml", kCrateAndTable);
  Observer observer{address("observer")};
  Process store{in_session("host", {"--name", "store", "--config", path("store.yaml")})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("store"); })) << store.output();
  // The hands are at the HRTC: the poses of a hand at a client would end with the gateway too. A tip has a radius of
  // 3 mm. It comes down only when the objects are there, because a hand gets no more energy from a movable object than
  // it has given to it.
  test_support::write_bytes(path("crate.csv"), "0,0,0,0.2\n5,0,0,0.13\n6,0,0,0.121\n");
  test_support::write_bytes(path("table.csv"), "0,0.3,0,0.2\n5,0.3,0,0.13\n6,0.3,0,0.121\n");
  Process desk{hrtc("desk", {"--flight-file", path("flight.mcap"), "--flight-recorder", "3600", "--users", "2",
                             "--replay", "ann=" + path("crate.csv"), "--replay", "bob=" + path("table.csv")})};
  const auto presses = [](const Seen& seen, const char* user) {
    const session::ProbeState state = seen.user(user).last;
    return state.force[2] > kPressed && std::abs(state.velocity[2]) < 1e-3;
  };
  const auto both_press = [&](const Seen& seen) { return presses(seen, "ann") && presses(seen, "bob"); };
  ASSERT_TRUE(observer.until(both_press)) << desk.output() << store.output();

  const std::uint64_t incarnation = observer.seen().user("ann").last.origin.incarnation;
  const pid_t gateway = gateway_of(desk);
  ASSERT_GT(gateway, 0);
  ::kill(gateway, SIGKILL);
  const std::int64_t killed_ns = realtime::monotonic_ns();
  // The next gateway is suspended while it loads its libraries, so that no gateway works for a known time.
  const auto until = Clock::now() + kWatchdog;
  pid_t successor = gateway;
  while ((successor == gateway || successor == 0) && Clock::now() < until) successor = gateway_of(desk);
  ASSERT_TRUE(successor != gateway && successor != 0) << desk.output();
  ::kill(successor, SIGSTOP);
  std::this_thread::sleep_for(Seconds{0.5});  // the time without a gateway under test
  const std::int64_t continued_ns = realtime::monotonic_ns();
  ::kill(successor, SIGCONT);
  ASSERT_TRUE(touch({"ann", "bob"}, observer, incarnation)) << desk.output();
  EXPECT_TRUE(observer.until(both_press)) << "the force does not return\n" << desk.output();
  desk.signal(SIGTERM);
  ASSERT_TRUE(exits_with(0, desk));

  const std::vector<Cycle> cycles = read_recording(path("flight.mcap"));
  const auto first_at = [&](std::int64_t time_ns) {
    return std::find_if(cycles.begin(), cycles.end(), [&](const Cycle& cycle) { return cycle.time_ns >= time_ns; });
  };
  const auto killed = first_at(killed_ns), continued = first_at(continued_ns);
  ASSERT_GT(killed - cycles.begin(), 100);
  ASSERT_GT(continued - killed, 100);
  EXPECT_TRUE(std::any_of(killed - 100, killed, [](const Cycle& cycle) { return cycle.forces[0] > kPressed; }));
  // A late cycle counts for at most 20 ms, as in the servo: if the whole machine was busy, so was the gateway. The
  // first cycle may still see a heartbeat.
  constexpr std::int64_t kPeriodNs = 1'000'000, kZeroNs = 60 * kPeriodNs + kPeriodNs, kMaxGapNs = 20 * kPeriodNs;
  std::int64_t silence_ns = 0, before_ns = killed->time_ns, last_force_ns = killed_ns;
  std::ptrdiff_t checked = 0;
  for (auto cycle = killed; cycle != continued; before_ns = cycle->time_ns, ++cycle) {
    silence_ns += std::min(cycle->time_ns - before_ns, kMaxGapNs);
    if (cycle->forces[0] != 0) last_force_ns = cycle->time_ns;
    if (silence_ns < kZeroNs) continue;
    ++checked;
    ASSERT_EQ(cycle->forces[0], 0) << "N, " << static_cast<double>(cycle->time_ns - killed_ns) * 1e-6
                                   << " ms after the kill, with " << static_cast<double>(silence_ns) * 1e-6
                                   << " ms of cycles since then";
  }
  EXPECT_GT(checked, 100) << "cycles without a gateway after 60 ms";
  RecordProperty("ms_until_zero_force", std::to_string(static_cast<double>(last_force_ns - killed_ns) * 1e-6));
  // The rule is that of movable objects: the force of the table stays. A late cycle can have stale poses, and no force.
  const auto lacks_force = [](const Cycle& cycle) { return cycle.forces[1] == 0; };
  EXPECT_LE(20 * std::count_if(killed, continued, lacks_force), continued - killed);
}

TEST_F(GatewayTest, LogsAFaultThatBeganWithoutAGateway) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk", {"--device", "ann=" TACTUS_EXAMPLE_WEIGHT ",0.3"})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk") && seen.user("ann").count > 0; }))
      << desk.output();
  const pid_t gateway = gateway_of(desk), driver = desk.child("tactus-device");
  ASSERT_GT(gateway, 0);
  ASSERT_GT(driver, 0);
  ::kill(gateway, SIGSTOP);
  ::kill(driver, SIGKILL);
  std::this_thread::sleep_for(Seconds{0.5});  // the servo notices the end; without a gateway, nothing shows it
  ::kill(gateway, SIGKILL);
  EXPECT_TRUE(desk.wait_for_line("the force of user ann is off until a reset")) << desk.output();
}

/// The test reads the memory maps while every shipped driver is in use. None ends for lack of its hardware:
/// tactus-evdev reads a named pipe instead of a mouse, and tactus-haply talks to a simulated service. The third is the
/// example.
/// The HRTC opens drivers only at its start, so a later state of the maps is enough.
TEST_F(GatewayTest, TheServoHasNoDdsNoImporterNoXmlParserAndNoDriver) {
  const std::string mouse = path("mouse");
  ASSERT_EQ(::mkfifo(mouse.c_str(), 0600), 0);
  const test_support::HaplyService haply{test_support::HaplyService::state};
  Observer observer{address("observer")};
  Process desk{
      hrtc("desk", {"--users", "3", "--device", "ann=" TACTUS_EXAMPLE_WEIGHT ",0.3", "--device",
                    "bob=" TACTUS_EVDEV ",mouse:" + mouse, "--device", "cid=" TACTUS_HAPLY "," + haply.address()})};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.is_present("desk") && seen.user("ann").count > 0 && seen.user("bob").count > 0;
  })) << desk.output();
  EXPECT_TRUE(haply.receives([](const auto& messages) { return messages.size() > 10; })) << desk.output();
  const int events = ::open(mouse.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC);
  ASSERT_GE(events, 0) << "the driver has closed the pipe";
  input_event motion{};
  motion.type = EV_REL;
  motion.code = REL_X;
  motion.value = 200;  // counts of 0.1 mm
  EXPECT_EQ(::write(events, &motion, sizeof motion), static_cast<ssize_t>(sizeof motion));
  ::close(events);
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.user("bob").last.device.position[0] > 0.015; }))
      << desk.output();

  const auto maps_of = [](pid_t pid) { return test_support::read_bytes("/proc/" + std::to_string(pid) + "/maps"); };
  const std::string servo = maps_of(desk.pid());
  EXPECT_THAT(maps_of(gateway_of(desk)), AnyOf(HasSubstr("libfastrtps"), HasSubstr("libfastdds")))
      << "the search finds it where it is";
  std::string children;
  for (const pid_t pid : desk.pids())
    if (pid != desk.pid()) children += maps_of(pid);
  for (const char* driver : {"weight", "tactus-evdev", "tactus-haply"}) {
    EXPECT_THAT(children, HasSubstr(driver)) << "the driver does not run";
    EXPECT_THAT(servo, Not(HasSubstr(driver)));
  }
  for (const char* library : {"fastrtps", "fastdds", "fastcdr", "assimp", "tinyxml", "expat", "libxml"})
    EXPECT_THAT(servo, Not(HasSubstr(library)));
}

}  // namespace
}  // namespace tactus::e2e
