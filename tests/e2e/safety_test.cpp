/// Emergency stops and resets of an operator, and what the participants publish and log about them.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <system_error>
#include <thread>
#include <utility>

#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;

class SafetyTest : public SessionTest {
 protected:
  [[nodiscard]] std::vector<std::string> control(std::vector<std::string> arguments) const {
    return in_session("control", std::move(arguments));
  }
};

constexpr char kTwoUsersHold[] = R"(name: two hold
duration: 120
users:
  - name: ann
    hrtc: desk
    script: [{approach: {object: "#1", direction: [0, 0, 1], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
  - name: bob
    hrtc: desk
    script: [{approach: {object: "#1", direction: [0, 1, 0], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
)";

bool has_force(const Seen& seen, const std::string& user) {
  const session::ProbeState state = seen.user(user).last;
  return std::hypot(state.force[0], state.force[1], state.force[2]) > 0.1;
}

bool is_stopped(const Seen& seen, const std::string& user) {
  const session::ProbeState state = seen.user(user).last;
  return std::string{session::fault_reason(state.status)} == "emergency stop" && !has_force(seen, user);
}

TEST_F(SafetyTest, AStopSwitchesAllForcesOffUntilAResetAndReportsItsReason) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kTwoUsersHold)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return has_force(seen, "ann") && has_force(seen, "bob"); }))
      << users.output() << desk.output();

  Process stop{control({"stop", "--reason", "needle bent"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return is_stopped(seen, "ann") && is_stopped(seen, "bob"); }));
  EXPECT_TRUE(desk.wait_for_line("emergency stop: needle bent"));
  EXPECT_TRUE(desk.wait_for_line("the force of user ann is off until a reset: emergency stop"));
  EXPECT_TRUE(exits_with(0, stop)) << stop.output();
  EXPECT_THAT(stop.output(), testing::HasSubstr("acknowledged by HRTCs: desk; by hosts: museum"));
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kInterventions[6]) == 2; }));

  Process reset{control({"reset", "--reason", "straight again"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return has_force(seen, "ann") && has_force(seen, "bob"); }));
  EXPECT_TRUE(exits_with(0, reset)) << reset.output();
  EXPECT_THAT(reset.output(), testing::HasSubstr("resets 1 stop\nacknowledged by HRTCs: desk; by hosts: museum"));

  Process end{control({"end", "--reason", "enough"})};
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, end)) << end.output();
  EXPECT_THAT(users.output(), testing::HasSubstr("the force of ann is off: emergency stop"));
  EXPECT_THAT(users.output(), testing::HasSubstr("FAULT 2"));
}

TEST_F(SafetyTest, ALocalStopStopsTheSessionUntilAReset) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kTwoUsersHold)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return has_force(seen, "ann") && has_force(seen, "bob"); }))
      << users.output() << desk.output();

  desk.signal(SIGUSR2);
  EXPECT_TRUE(observer.until([](const Seen& seen) { return is_stopped(seen, "ann") && is_stopped(seen, "bob"); }));
  EXPECT_TRUE(desk.wait_for_line("emergency stop at this HRTC, by the stop button of a device or a signal"));
  Process reset{control({"reset"})};
  EXPECT_TRUE(exits_with(0, reset)) << reset.output();
  EXPECT_THAT(reset.output(), testing::HasSubstr("resets 1 stop\nacknowledged by HRTCs: desk; by hosts: museum"));
  EXPECT_TRUE(observer.until([](const Seen& seen) { return has_force(seen, "ann") && has_force(seen, "bob"); }));
}

/// An HRTC of two processes, and one of one process.
class StopAtTheStart : public SafetyTest, public testing::WithParamInterface<bool> {};

TEST_P(StopAtTheStart, ALocalStopWhileADriverOpensIsObeyedFromTheFirstCycle) {
  Observer observer{address("observer")};
  const std::string file = path("writes");
  std::vector<std::string> options{"--device", "ann=" TACTUS_DRIVER_WITH_DEFECTS ",opens slowly:" + file};
  if (GetParam()) options.emplace_back("--one-process");
  Process desk{hrtc("desk", options)};
  for (const auto end = std::chrono::steady_clock::now() + kWatchdog;
       !std::filesystem::exists(file) && std::chrono::steady_clock::now() < end;)
    std::this_thread::sleep_for(2ms);  // a file notifies nobody
  desk.signal(SIGUSR1);
  desk.signal(SIGUSR2);
  EXPECT_TRUE(desk.wait_for_line("emergency stop at this HRTC, by the stop button of a device or a signal"))
      << desk.output();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").count > 10; })) << desk.output();
  const StateCounts ann = observer.seen().user("ann");
  EXPECT_EQ(ann.faults, ann.count) << "each state has the fault, so the force is zero";
  EXPECT_STREQ(session::fault_reason(ann.last.status), "emergency stop");

  Process reset{control({"reset"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return (seen.user("ann").last.status & session::kFault) == 0; }))
      << desk.output();
  EXPECT_TRUE(exits_with(0, reset)) << reset.output();
}

INSTANTIATE_TEST_SUITE_P(Processes, StopAtTheStart, testing::Bool(),
                         [](const auto& one) { return std::string{one.param ? "One" : "Two"}; });

TEST_F(SafetyTest, ALocalStopSignalsEveryHrtcOfTheMachineAndNoOtherProgram) {
  // In its own process namespace, because a local stop would signal the HRTCs of other tests too. A chroot may have none.
  Process trial{{"/usr/bin/unshare", "--pid", "--fork", "--mount-proc", "true"}};
  if (trial.wait() != 0) GTEST_SKIP() << "no process namespace: " << trial.output();
  const std::string program_of_hrtc = path("tactus-hrtc");
  std::filesystem::copy_file("/bin/sleep", program_of_hrtc);
  Process machine{{"/usr/bin/unshare", "--pid", "--fork", "--mount-proc", "bash", "-c", R"(
      exec 3>&2 2>/dev/null  # without the messages of the shell on the signals
      "$0" 60 & first=$!
      "$0" 60 & second=$!
      sleep 60 & other=$!
      for one in $first $second; do until [[ $(</proc/$one/comm) == tactus-hrtc ]]; do sleep 0.01; done; done
      "$1" stop --local 2>&3; echo "local stop $?"
      wait $first; echo "first $?"
      wait $second; echo "second $?"
      kill $other; wait $other; echo "other $?"
      "$1" stop --local 2>&3; echo "local stop $?")",
                   program_of_hrtc, program("control", {}).front()}};
  EXPECT_TRUE(exits_with(0, machine));
  const std::string output = machine.output();
  EXPECT_THAT(output, testing::HasSubstr("local stop 0\nfirst 140\nsecond 140\nother 143\n")) << "140: by SIGUSR2";
  EXPECT_THAT(output, testing::HasSubstr("no HRTC found on this machine\nlocal stop 1\n"));
}

TEST_F(SafetyTest, AStopAppliesToProgramsThatJoinAfterItUntilAReset) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process stop{control({"stop", "--reason", "needle bent"})};
  ASSERT_TRUE(exits_with(1, stop)) << "expected to fail, because no HRTC can acknowledge the stop: " << stop.output();

  Process desk{hrtc("desk")};  // only the host can forward the stop to this HRTC
  ASSERT_TRUE(desk.wait_for_line("emergency stop, relayed by host 'museum'"));
  Process users{sim(kTwoUsersHold)};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return is_stopped(seen, "ann") && is_stopped(seen, "bob"); }))
      << users.output() << desk.output();
  museum.signal(SIGKILL);
  Process gallery{host("gallery", models().sphere)};  // only the HRTC can forward the stop to this host
  ASSERT_TRUE(gallery.wait_for_line("emergency stop, relayed by HRTC 'desk'"));

  Process reset{control({"reset"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return has_force(seen, "ann") && has_force(seen, "bob"); }))
      << users.output() << desk.output();
  Process table{hrtc("table")};
  EXPECT_TRUE(table.wait_for_line("HRTC 'desk' joined"));
  EXPECT_THAT(table.output(), testing::Not(testing::HasSubstr("emergency stop")));
}

TEST_F(SafetyTest, AResetEndsOnlyTheStopsThatItNames) {
  Observer observer{address("observer")};
  wire::Writer<session::EmergencyStop> stop_out{observer.participants(), wire::topics::kStop};
  wire::Writer<session::ForceReset> reset_out{observer.participants(), wire::topics::kReset};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  const session::Origin self = observer.participants().origin();
  const auto stop_record = [&](const Seen& seen) {
    if (seen.is_present("desk"))
      for (const session::StopRecord& record : seen.roster.at("desk").stops)
        if (record.participant == self.participant) return record;
    return session::StopRecord{};
  };
  ASSERT_TRUE(observer.until([&](const Seen& seen) {
    (void)stop_out.send({self, 2, "needle bent"});
    return stop_record(seen).stop == 2;
  })) << desk.output();
  ASSERT_TRUE(observer.until([&](const Seen& seen) {
    (void)reset_out.send({self, 1, {{self.participant, self.incarnation, 1}}, "stop 1 is over"});
    return stop_record(seen).reset == 1;
  })) << desk.output();
  EXPECT_TRUE(desk.wait_for_line("forces are reset: stop 1 is over; another stop is in force"));
  EXPECT_EQ(stop_record(observer.seen()).ended, 1u);

  Process reset{control({"reset"})};
  EXPECT_TRUE(exits_with(0, reset)) << reset.output();
  EXPECT_TRUE(observer.until([&](const Seen& seen) { return stop_record(seen).ended == 2; })) << desk.output();
}

/// A pipe of one page. Once nobody reads it, an HRTC that logs its contacts into this pipe blocks its service thread.
class PipeOfOnePage {
 public:
  explicit PipeOfOnePage(const std::string& path) {
    if (mkfifo(path.c_str(), 0600) != 0) throw std::system_error{errno, std::generic_category(), path};
    read_end_ = open(path.c_str(), O_RDONLY | O_NONBLOCK);
    if (read_end_ < 0) throw std::system_error{errno, std::generic_category(), path};
    if (fcntl(read_end_, F_SETPIPE_SZ, 4096) < 0) throw std::system_error{errno, std::generic_category(), path};
  }
  ~PipeOfOnePage() { close(read_end_); }
  PipeOfOnePage(const PipeOfOnePage&) = delete;
  PipeOfOnePage& operator=(const PipeOfOnePage&) = delete;

  void read_all() const {
    std::array<char, 4096> bytes{};
    while (read(read_end_, bytes.data(), bytes.size()) > 0) {
    }
  }

 private:
  int read_end_ = -1;
};

TEST_F(SafetyTest, AStopSwitchesTheForceOffWhileTheServiceThreadIsBlocked) {
  Observer observer{address("observer")};
  wire::Writer<session::EmergencyStop> stop_out{observer.participants(), wire::topics::kStop};
  const PipeOfOnePage log{path("log")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--log", path("log")})};
  Process users{sim(kTwoUsersHold)};
  ASSERT_TRUE(observer.until([&](const Seen& seen) {
    log.read_all();
    return has_force(seen, "ann");
  })) << users.output()
      << desk.output();
  // If 500 probe states (0.5 s, five heartbeats) arrive after the newest heartbeat, the service thread is blocked; the
  // sender thread still works.
  std::uint64_t heartbeat = 0, states_at_heartbeat = 0;
  ASSERT_TRUE(observer.until([&](const Seen& seen) {
    if (!seen.is_present("desk")) return false;
    const std::uint64_t states = seen.user("ann").count;
    const std::uint64_t newest = seen.roster.at("desk").heartbeat;
    if (newest != std::exchange(heartbeat, newest)) states_at_heartbeat = states;
    return states > states_at_heartbeat + 500 && has_force(seen, "ann");
  })) << users.output()
      << desk.output();

  EXPECT_TRUE(observer.until([&](const Seen& seen) {
    (void)stop_out.send({observer.participants().origin(), 1, "needle bent"});  // repeated: best effort
    return is_stopped(seen, "ann");
  }));
}

/// An HRTC that sends roster entries, and obeys no stop.
class DeafHrtc {
 public:
  explicit DeafHrtc(const wire::SessionAddress& address) : participants_{address} {
    entry_.role = session::Role::kHrtc;
    entry_.name = address.participant;
    entry_.session = address.session;
  }
  /// Sends entries until a program has sent a stop, and then for another half second.
  void run_until_a_stop() {
    const auto limit = std::chrono::steady_clock::now() + kWatchdog;
    for (int left = 25; left > 0 && std::chrono::steady_clock::now() < limit; left -= is_stopped_ ? 1 : 0) {
      entry_.origin = participants_.origin();
      ++entry_.heartbeat;
      ASSERT_EQ(roster_.send(entry_), wire::SendStatus::kSent);
      std::this_thread::sleep_for(20ms);  // between two heartbeats
    }
    EXPECT_TRUE(is_stopped_);
  }

 private:
  wire::Participants participants_;
  session::RosterEntry entry_;
  std::atomic<bool> is_stopped_{false};
  wire::Writer<session::RosterEntry> roster_{participants_, wire::topics::kRoster};
  wire::Reader<session::EmergencyStop> stops_{participants_, wire::topics::kStop,
                                              [this](session::EmergencyStop&&) { is_stopped_ = true; }};
};

TEST_F(SafetyTest, AStopFailsIfAnHrtcFallsSilentBeforeItHasAcknowledgedIt) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk"); })) << desk.output();
  DeafHrtc table{address("table")};
  Process stop{control({"stop", "--patience", "3"})};
  table.run_until_a_stop();
  EXPECT_TRUE(exits_with(1, stop)) << stop.output();
  EXPECT_THAT(stop.output(), testing::HasSubstr("acknowledged by HRTCs: desk; by hosts: none\n"
                                                "not acknowledged by: table\n"));
}

TEST_F(SafetyTest, AStopContinuesWithoutAPeerWhoseNameDoesNotResolve) {
  Observer observer{address("observer")};
  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk"); })) << desk.output();
  Process stop{control({"stop", "--peer", "127.0.0.1", "--peer", "no.such.host.invalid"})};
  EXPECT_TRUE(exits_with(0, stop)) << stop.output();
  EXPECT_THAT(stop.output(), testing::ContainsRegex("'no.such.host.invalid' does not resolve to an IPv4 address.*; "
                                                    "this program continues without this peer"));
  Process lost{control({"stop", "--peer", "no.such.host.invalid"})};
  EXPECT_TRUE(exits_with(2, lost)) << lost.output();
}

TEST_F(SafetyTest, AStopWithoutAnyHostOrHrtcFails) {
  Process stop{control({"stop", "--patience", "0.2"})};
  EXPECT_TRUE(exits_with(1, stop));
  EXPECT_THAT(stop.output(), testing::HasSubstr("no host or HRTC found in session"));
}

}  // namespace
}  // namespace tactus::e2e
