#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <thread>

#include "tests/support/constants.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/chaos/health.hpp"
#include "tools/chaos/plan.hpp"
#include "tools/chaos/programs.hpp"

namespace tactus::chaos {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::int64_t kMs = 1'000'000;

std::vector<Program> session_programs() {
  Program host, gateway, sim;
  host.label = "host museum";
  gateway.label = "gateway desk";
  gateway.restart = Restart::kItsSupervisor;
  sim.label = "sim";
  return {gateway, host, sim};
}

const std::vector<FaultKind> kAllKinds{FaultKind::kSuspend, FaultKind::kKill, FaultKind::kLoss, FaultKind::kCut};

std::vector<std::string> first_faults(std::uint64_t seed, std::size_t count) {
  Plan plan{seed, kAllKinds, 4};
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < count; ++i) texts.push_back(text(plan.next(session_programs())));
  return texts;
}

TEST(ChaosPlan, IsTheSameForTheSameSeed) {
  EXPECT_EQ(first_faults(7, 50), first_faults(7, 50));
  EXPECT_NE(first_faults(7, 50), first_faults(8, 50));
}

TEST(ChaosPlan, KillsOnlyProgramsThatStartAgain) {
  Plan plan{1, kAllKinds, 4};
  std::set<FaultKind> kinds;
  for (int i = 0; i < 500; ++i) {
    const Fault fault = plan.next(session_programs());
    kinds.insert(fault.kind);
    if (fault.kind == FaultKind::kKill) {
      EXPECT_EQ(fault.program, "gateway desk");
    }
    EXPECT_LE(fault.pause, 4);
    EXPECT_LE(fault.percent, 30);
  }
  EXPECT_EQ(kinds.size(), kFaultKinds);
}

TEST(ChaosPlan, HasNoFaultIfNoneIsPossible) {
  Plan plan{1, {FaultKind::kKill}, 4};
  Program host;
  host.label = "host museum";
  EXPECT_THROW((void)plan.next({host}), NoPossibleFault);
}

class HealthTest : public testing::Test {
 protected:
  session::RosterEntry entry(std::uint64_t participant, session::Role role, const std::string& name) {
    session::RosterEntry entry;
    entry.origin = {kSession, participant, 1, now_};
    entry.role = role;
    entry.name = name;
    entry.heartbeat = ++heartbeat_;
    if (role == session::Role::kHrtc) entry.served_users = {{"ann", 0}};
    return entry;
  }
  session::ProbeState state(std::uint32_t status, double force = 1, std::uint64_t incarnation = 1) {
    session::ProbeState state;
    state.origin = {kSession, kHrtc, incarnation, now_};
    state.user_id = session::id_of("ann");
    state.status = status;
    state.force = {0, 0, force};
    return state;
  }
  /// Host and HRTC publish for `ms`, unless omitted, and the user has this status.
  void run(int ms, std::uint32_t status, bool has_host = true) {
    for (int i = 0; i < ms; i += 10) {
      now_ += 10 * kMs;
      if (i % 100 == 0) {
        if (has_host) health_.on_sample(entry(kHost, session::Role::kHost, "museum"), now_);
        health_.on_sample(entry(kHrtc, session::Role::kHrtc, "desk"), now_);
      }
      health_.on_sample(state(status), now_);
      health_.tick(now_);
    }
  }

  static constexpr std::uint32_t kTouch = session::kInContact | session::kExact;
  std::int64_t now_ = 1'000'000 * kMs;
  std::uint64_t heartbeat_ = 0;
  Health health_{{kSession, 99, 1, 0}, {}};
};

TEST_F(HealthTest, MissesNothingWhileAllPublish) {
  run(1000, kTouch);
  health_.set_reference(now_);
  EXPECT_THAT(health_.reference_text(), HasSubstr("museum"));
  EXPECT_THAT(health_.reference_text(), HasSubstr("user ann"));
  run(1000, kTouch);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
  EXPECT_THAT(health_.violations(), IsEmpty());
}

TEST_F(HealthTest, MissesASilentHostUntilItReturns) {
  run(1000, kTouch);
  health_.set_reference(now_);
  run(400, kTouch, false);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("museum")));
  run(200, kTouch);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
}

TEST_F(HealthTest, MissesAUserWithoutStatesWithoutForcesOrWithoutExactContact) {
  run(1000, kTouch);
  health_.set_reference(now_);
  run(10, session::kInContact);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("not exact")));
  run(10, session::kFault);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("user ann")));
  run(10, session::kStalePose);
  EXPECT_THAT(health_.missing(now_), ElementsAre(HasSubstr("no poses")));
  run(10, kTouch);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
  EXPECT_THAT(health_.missing(now_ + 251 * kMs), ElementsAre(HasSubstr("no states")));
}

TEST_F(HealthTest, DoesNotExpectAnExactContactThatNeverWas) {
  run(1000, session::kInContact);
  health_.set_reference(now_);
  run(10, session::kInContact);
  EXPECT_THAT(health_.missing(now_), IsEmpty());
}

TEST_F(HealthTest, ReportsAForceAboveTheLimit) {
  health_.on_sample(state(kTouch, 8), now_);
  EXPECT_THAT(health_.violations(), IsEmpty());
  health_.on_sample(state(kTouch, 8.1), now_);
  EXPECT_THAT(health_.violations(), ElementsAre(HasSubstr("8.1 N, expected at most 8 N")));
  EXPECT_DOUBLE_EQ(health_.max_force(), 8.1);
}

TEST_F(HealthTest, ReportsAStateOfAnEarlierProcess) {
  health_.on_sample(state(kTouch, 1, 2), now_);
  health_.on_sample(state(kTouch, 1, 1), now_);
  EXPECT_THAT(health_.violations(), ElementsAre(HasSubstr("earlier process")));
}

TEST_F(HealthTest, StoresNoMoreThan4096UsersAndHrtcs) {
  session::RosterEntry hrtc = entry(kHrtc, session::Role::kHrtc, "desk");
  hrtc.served_users.clear();
  for (std::uint64_t i = 0; i < 5000; ++i) {
    session::ProbeState of_another = state(kTouch);
    of_another.user_id = i;
    of_another.origin.participant = 1000 + i;  // not kHrtc
    health_.on_sample(of_another, now_);
    hrtc.served_users.push_back({"user" + std::to_string(i), 0});
  }
  health_.on_sample(hrtc, now_);
  health_.set_reference(now_);
  const std::string users = health_.reference_text();
  EXPECT_EQ(std::count(users.begin(), users.end(), ','), 4096) << "the HRTC and 4096 users";

  health_.on_sample(state(kTouch, 1, 2), now_);
  health_.on_sample(state(kTouch, 1, 1), now_);
  EXPECT_THAT(health_.violations(), IsEmpty()) << "the processes of this HRTC are not stored";
  session::ProbeState strong = state(kTouch, 9);
  strong.user_id = session::id_of("user4999");
  health_.on_sample(strong, now_);
  EXPECT_THAT(health_.violations(), ElementsAre(HasSubstr(std::to_string(strong.user_id)))) << "without its name";
}

/// Polls `condition` for at most 5 s, because /proc reports no changes.
template <class Condition>
bool eventually(const Condition& condition) {
  for (int i = 0; i < 500; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds{10});  // between two reads of /proc
  }
  return false;
}

/// A process whose program has the name of a host. It ends when this object is destroyed.
class FakeHost {
 public:
  /// `first_line`: of its script, in which $FIFO is a file that nobody writes.
  explicit FakeHost(const std::string& first_line = "") {
    std::filesystem::copy_file("/bin/bash", folder_.path() / "tactus-host");
    // It waits for a line that nobody writes. It starts no other process, because a process has the command line of its
    // parent until it runs its own program. The shell ignores the arguments after the command.
    const std::filesystem::path fifo = folder_.path() / "fifo";
    EXPECT_EQ(::mkfifo(fifo.c_str(), S_IRUSR | S_IWUSR), 0);
    process_.emplace(
        std::vector<std::string>{folder_.path() / "tactus-host", "-c",
                                 "FIFO=" + fifo.string() + "; echo runs; " + first_line + "read -r _ <>$FIFO",
                                 "--session", session_, "--domain=40", "--name", "museum"});
  }
  ~FakeHost() {
    for (const Program& program : found()) ::kill(program.pid, SIGKILL);
  }
  FakeHost(const FakeHost&) = delete;
  FakeHost& operator=(const FakeHost&) = delete;

  [[nodiscard]] std::vector<Program> found(int domain = 40, bool may_start = true) const {
    return programs_of(session_, domain, may_start);
  }
  /// Waits until exactly one such program runs that is not `former`.
  [[nodiscard]] std::optional<Program> wait_for_another_than(pid_t former) const {
    std::vector<Program> programs;
    const bool runs = eventually([&] { return (programs = found()).size() == 1 && programs[0].pid != former; });
    return runs ? std::optional{programs[0]} : std::nullopt;
  }
  [[nodiscard]] e2e::Process& process() { return *process_; }

 private:
  std::string session_ = "chaos." + std::to_string(::getpid());
  test_support::TemporaryFolder folder_;
  std::optional<e2e::Process> process_;
};

/// The letter that /proc shows: T is a suspended process.
char state_of(pid_t pid) {
  std::ifstream file{"/proc/" + std::to_string(pid) + "/stat"};
  std::string stat;
  std::getline(file, stat);
  return stat.at(stat.rfind(')') + 2);
}
bool gets_state(pid_t pid, bool is_suspended) {
  return eventually([&] { return (state_of(pid) == 'T') == is_suspended; });
}

TEST(ChaosPrograms, AreFoundBySessionAndDomain) {
  FakeHost host;
  ASSERT_TRUE(host.process().wait_for_line("runs"));
  const std::vector<Program> found = host.found();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].label, "host museum");
  EXPECT_EQ(found[0].restart, Restart::kChaos);
  EXPECT_EQ(host.found(40, false).at(0).restart, Restart::kNobody);
  EXPECT_THAT(host.found(41), IsEmpty()) << "another domain";
  EXPECT_THAT(programs_of("no such session", 40, true), IsEmpty());
  const auto resources = resources_of(found[0]);
  ASSERT_TRUE(resources);
  EXPECT_GT(resources->resident_mb, 0.5);
  EXPECT_GE(resources->descriptors, 3u);
  EXPECT_GE(age_of(found[0]), 0);
  EXPECT_LT(age_of(found[0]), 30);
}

TEST(ChaosPrograms, AreMeasuredWithoutAFileThatTheyWriteAtTheMoment) {
  FakeHost host{"read -r -t 0.5 _ <>$FIFO 9>/dev/null; "};
  ASSERT_TRUE(host.process().wait_for_line("runs"));
  const Program program = host.found().at(0);
  const std::filesystem::path file = "/proc/" + std::to_string(program.pid) + "/fd/9";
  ASSERT_TRUE(eventually([&] { return std::filesystem::exists(file); }));
  const std::size_t writing = settled_resources_of(program, 0, std::chrono::milliseconds{0})->descriptors;
  EXPECT_LT(settled_resources_of(program, writing - 1, std::chrono::seconds{5})->descriptors, writing);
}

TEST(ChaosPrograms, AreSuspendedForATime) {
  FakeHost host;
  ASSERT_TRUE(host.process().wait_for_line("runs"));
  const Program program = host.found().at(0);
  {
    const Suspension suspension{program, 60};
    EXPECT_TRUE(gets_state(program.pid, true));
  }
  EXPECT_TRUE(gets_state(program.pid, false));
  const Suspension suspension{program, 0.2};
  EXPECT_TRUE(gets_state(program.pid, true));
  EXPECT_TRUE(gets_state(program.pid, false)) << "the child process has to resume it";
}

TEST(ChaosPrograms, StartAgainWithTheirCommandAndOutputAndWithoutDescriptorsOfThisProcess) {
  FakeHost host;
  ASSERT_TRUE(host.process().wait_for_line("runs"));
  const Program before = host.found().at(0);
  const int inherited = ::open("/dev/null", O_RDONLY);  // as a socket of the DDS library, without O_CLOEXEC
  kill_and_restart(before);
  ::close(inherited);
  const std::optional<Program> after = host.wait_for_another_than(before.pid);
  ASSERT_TRUE(after);
  EXPECT_EQ(after->label, "host museum");
  for (const auto& entry : std::filesystem::directory_iterator{"/proc/" + std::to_string(after->pid) + "/fd"})
    EXPECT_NE(entry.path().filename(), std::to_string(inherited));
  EXPECT_FALSE(resources_of(before)) << "the killed process";
  EXPECT_THROW(Suspension(before, 1), ProgramEnded);
  EXPECT_THROW(kill_and_restart(before), ProgramEnded);
}

TEST(ChaosPrograms, ThatCannotStartAgainAfterTheirEndAreReported) {
  const test_support::TemporaryFolder parent;
  const std::filesystem::path folder = parent.path() / "of the host";
  std::filesystem::create_directory(folder);
  FakeHost host{"cd '" + folder.string() + "'; "};
  ASSERT_TRUE(host.process().wait_for_line("runs"));
  const Program program = host.found().at(0);
  const std::filesystem::path link = "/proc/" + std::to_string(program.pid) + "/cwd";
  ASSERT_TRUE(eventually([&] { return std::filesystem::read_symlink(link) == folder; }));
  std::filesystem::remove(folder);
  EXPECT_THROW(kill_and_restart(program), NotRestarted);
  EXPECT_THAT(host.found(), IsEmpty());
}

}  // namespace
}  // namespace tactus::chaos
