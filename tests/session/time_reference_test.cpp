#include "session/time_reference.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <deque>
#include <memory>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

constexpr std::int64_t kTickNs = 5 * kMs;

/// The parts of a program that concern session time. Its incarnation is the time of its wall clock, which may be wrong.
class Program {
 public:
  Program(std::uint64_t id, Role in_role, std::uint64_t incarnation, std::int64_t local_ns)
      : self{kSession, id, incarnation, 0}, role{in_role}, roster{self, {}}, clock{self, {}, local_ns} {}

  [[nodiscard]] RosterEntry entry(std::int64_t local_ns) {
    RosterEntry entry;
    entry.origin = self;
    entry.role = role;
    entry.name = std::to_string(self.participant);
    entry.heartbeat = ++beats;
    put_time(clock, force_on, local_ns, entry);
    return entry;
  }

  Origin self;
  Role role;
  Roster roster;
  SessionClock clock;
  bool force_on = false;
  std::uint64_t beats = 0;
};

/// Programs on machines whose monotonic clocks start at random times. Samples arrive without delay, unless the two
/// machines are cut off from each other.
class TimeReferenceTest : public testing::Test {
 protected:
  struct Machine {
    std::int64_t offset_ns = 0;
    std::unique_ptr<Program> program;
    std::int64_t session_ns = -1, local_ns = 0;  // at the last tick
    std::int64_t max_step_ns = 0;                // of session time, while a force was on
  };

  std::size_t start(std::uint64_t id, Role role, std::uint64_t incarnation) {
    Machine machine;
    machine.offset_ns = static_cast<std::int64_t>(random_() % 4'000'000'000'000);
    machines_.push_back(std::move(machine));
    restart(machines_.size() - 1, id, role, incarnation);
    return machines_.size() - 1;
  }
  void restart(std::size_t at, std::uint64_t id, Role role, std::uint64_t incarnation) {
    machines_[at].program = std::make_unique<Program>(id, role, incarnation, local(at));
    machines_[at].session_ns = -1;
  }
  void stop(std::size_t at) { machines_[at].program.reset(); }
  [[nodiscard]] std::int64_t local(std::size_t at) const { return now_ns_ + machines_[at].offset_ns; }
  [[nodiscard]] Program& program(std::size_t at) { return *machines_[at].program; }
  [[nodiscard]] std::int64_t session(std::size_t at) { return program(at).clock.map().session_time(local(at)); }
  [[nodiscard]] std::uint64_t reference(std::size_t at) { return program(at).clock.reference(); }
  void cut(std::size_t a, std::size_t b, bool disconnect = true) {
    if (disconnect)
      cuts_.insert(std::minmax(a, b));
    else
      cuts_.erase(std::minmax(a, b));
  }
  [[nodiscard]] bool reaches(std::size_t a, std::size_t b) const {
    return a != b && machines_[b].program != nullptr && cuts_.count(std::minmax(a, b)) == 0;
  }

  void tick() {
    now_ns_ += kTickNs;
    ++ticks_;
    for (std::size_t at = 0; at < machines_.size(); ++at) {
      if (machines_[at].program == nullptr) continue;
      Program& ticked = program(at);
      (void)ticked.roster.tick(local(at));
      update_session_clock(ticked.roster, ticked.self, ticked.role, ticked.force_on, local(at), ticked.clock);
      if (ticks_ % 20 == at % 20) {
        const RosterEntry entry = ticked.entry(local(at));
        for (std::size_t to = 0; to < machines_.size(); ++to)
          if (reaches(at, to)) (void)program(to).roster.on_entry(entry, local(to));
      }
      if (ticks_ % 4 == at % 4) request_time(at);
      measure(at);
    }
  }
  void request_time(std::size_t at) {
    for (std::size_t to = 0; to < machines_.size(); ++to) {
      if (!reaches(at, to) || program(to).self.participant != reference(at)) continue;
      const ClockSample request = program(at).clock.request(local(at));
      if (program(to).clock.answers_requests())
        (void)program(at).clock.on_answer(program(to).clock.answer(request, local(to), local(to)), local(at));
    }
  }
  void measure(std::size_t at) {
    Machine& machine = machines_[at];
    const std::int64_t session_ns = session(at), local_ns = local(at);
    if (machine.session_ns >= 0 && program(at).force_on) {
      const std::int64_t gained_ns = session_ns - machine.session_ns - (local_ns - machine.local_ns);
      machine.max_step_ns = std::max(machine.max_step_ns, std::abs(gained_ns));
    }
    machine.session_ns = session_ns;
    machine.local_ns = local_ns;
  }
  void run(std::int64_t ms) {
    for (std::int64_t i = 0; i < ms * kMs / kTickNs; ++i) tick();
  }
  [[nodiscard]] std::int64_t difference(std::size_t a, std::size_t b) { return std::abs(session(a) - session(b)); }

  static Role role_of(std::size_t at) { return at % 3 == 2 ? Role::kHost : Role::kHrtc; }
  /// Stops or starts a program, begins or ends a partition, or switches a force on or off.
  void apply_random_event() {
    const std::size_t at = random_() % machines_.size(), other = random_() % machines_.size();
    switch (random_() % 6) {
      case 0:
        stop(at);
        break;
      case 1:
        if (machines_[at].program == nullptr) restart(at, at + 1, role_of(at), random_());
        break;
      case 2:
        for (std::size_t i = 0; i < machines_.size(); ++i)
          for (std::size_t j = 0; j < i; ++j) cut(i, j, i % 2 != j % 2);
        break;
      case 3:
        cuts_.clear();
        break;
      case 4:
        if (at != other) cut(at, other);
        break;
      default:
        if (machines_[at].program != nullptr) program(at).force_on = !program(at).force_on;
    }
  }

  /// Max change of the clock in a tick by slewing.
  static constexpr std::int64_t kSlewedNs = kTickNs / 20 + 2;

  std::mt19937_64 random_{1};
  std::int64_t now_ns_ = 0;
  std::size_t ticks_ = 0;
  std::vector<Machine> machines_;
  std::set<std::pair<std::size_t, std::size_t>> cuts_;
};

TEST_F(TimeReferenceTest, AMachineWithAWallClockIn1970DoesNotBecomeTheReference) {
  const std::size_t first = start(20, Role::kHost, 1'700'000'000'000'000'000);
  run(60'000);
  const std::int64_t before_ns = session(first);
  const std::size_t wrong = start(10, Role::kHrtc, 30'000'000'000);
  run(5'000);

  EXPECT_EQ(reference(first), 20u);
  EXPECT_EQ(reference(wrong), 20u);
  EXPECT_EQ(session(first) - before_ns, 5'000 * kMs);
  EXPECT_LT(difference(first, wrong), kMs);
}

TEST_F(TimeReferenceTest, ASingleHostBeginsASessionAfterTheSettleTime) {
  const std::size_t host = start(20, Role::kHost, 5);
  const std::size_t client = start(1, Role::kClient, 5);
  run(900);
  EXPECT_EQ(reference(host), 0u);
  run(600);
  EXPECT_EQ(reference(host), 20u);
  EXPECT_EQ(reference(client), 20u) << "a client follows the host";
  EXPECT_LT(difference(host, client), kMs);
}

TEST_F(TimeReferenceTest, TheRemainingProgramsContinueTheTimeWhenTheReferenceStops) {
  const std::size_t host = start(20, Role::kHost, 5), hrtc = start(40, Role::kHrtc, 6),
                    third = start(30, Role::kHrtc, 7);
  run(5'000);
  program(hrtc).force_on = program(third).force_on = true;
  stop(host);
  run(5'000);

  EXPECT_EQ(reference(hrtc), 30u);
  EXPECT_EQ(reference(third), 30u);
  EXPECT_LT(difference(hrtc, third), kMs);
  EXPECT_LE(machines_[hrtc].max_step_ns, kSlewedNs);
  EXPECT_LE(machines_[third].max_step_ns, kSlewedNs);
  restart(host, 20, Role::kHost, 8);
  run(5'000);
  EXPECT_EQ(reference(host), 30u) << "the restarted host joined last";
  EXPECT_LT(difference(hrtc, host), kMs);
}

TEST_F(TimeReferenceTest, AYoungerSessionMergesWithAnOlderSessionOnceNoForceIsOn) {
  const std::size_t older = start(20, Role::kHost, 5), with_older = start(21, Role::kHrtc, 5);
  run(30'000);
  const std::size_t younger = start(10, Role::kHost, 1), with_younger = start(11, Role::kHrtc, 1);
  for (const std::size_t a : {older, with_older})
    for (const std::size_t b : {younger, with_younger}) cut(a, b);
  run(10'000);
  ASSERT_GT(difference(older, younger), 20'000 * kMs);
  const std::int64_t before_ns = session(older);
  program(with_younger).force_on = true;
  program(with_older).force_on = true;  // has no effect, because the time of the older session does not change
  run(200);
  cuts_.clear();
  run(10'000);

  EXPECT_EQ(reference(younger), 10u);
  EXPECT_EQ(reference(with_younger), 10u);
  EXPECT_LT(difference(younger, with_younger), kMs) << "the younger session has one time before the merge";
  EXPECT_LE(machines_[with_younger].max_step_ns, kSlewedNs);
  program(with_younger).force_on = false;
  run(2'000);
  for (const std::size_t at : {older, with_older, younger, with_younger}) {
    EXPECT_EQ(reference(at), 20u);
    EXPECT_LT(difference(at, older), kMs);
  }
  EXPECT_EQ(session(older) - before_ns, 12'200 * kMs);
  EXPECT_LE(machines_[with_older].max_step_ns, kSlewedNs);
  EXPECT_GT(program(younger).clock.joined_ns(), program(with_older).clock.joined_ns())
      << "the younger session joined later";
}

// Roster entries can state up to 2^60 ns. Programs that follow such a reference could send none soon.
TEST_F(TimeReferenceTest, AReferenceWhoseTimeAlmostEndsIsIgnored) {
  const std::size_t host = start(20, Role::kHost, 5), hrtc = start(40, Role::kHrtc, 6);
  run(3'000);
  RosterEntry liar;
  liar.origin = {kSession, 10, 1, 0};
  liar.role = Role::kHost;
  liar.name = "10";
  liar.reference = 10;
  liar.session_time_ns = (INT64_C(1) << 60) - 5'000 * kMs;
  liar.joined_ns = 0;
  for (int second = 0; second < 10; ++second) {
    ++liar.heartbeat;
    (void)program(host).roster.on_entry(liar, local(host));
    (void)program(hrtc).roster.on_entry(liar, local(hrtc));
    run(100);
    ASSERT_EQ(reference(host), 20u) << second;
    ASSERT_EQ(reference(hrtc), 20u) << second;
  }
}

TEST_F(TimeReferenceTest, APartitionedParticipantRejoinsUnderAForceWithoutAStep) {
  const std::size_t host = start(20, Role::kHost, 5), hrtc = start(40, Role::kHrtc, 6);
  run(5'000);
  program(hrtc).force_on = true;
  cut(host, hrtc);
  run(5'000);
  ASSERT_EQ(reference(hrtc), 40u);
  cut(host, hrtc, false);
  run(2'000);

  EXPECT_EQ(reference(hrtc), 20u) << "the host joined first";
  EXPECT_EQ(reference(host), 20u);
  EXPECT_LE(machines_[hrtc].max_step_ns, kSlewedNs);
}

TEST_F(TimeReferenceTest, ANewParticipantSynchronisesWhileOtherParticipantsExertForces) {
  start(20, Role::kHost, 5);
  const std::size_t hrtc = start(40, Role::kHrtc, 6);
  run(5'000);
  program(hrtc).force_on = true;
  const std::size_t newcomer = start(30, Role::kHrtc, 7);
  run(1'000);

  EXPECT_TRUE(program(newcomer).clock.synchronised());
  EXPECT_LT(difference(hrtc, newcomer), kMs);
}

/// Programs start and stop, partitions begin and end, and forces go on and off at random. Wall clocks are random too.
TEST_F(TimeReferenceTest, NoTimeStepsUnderAForceAndAllTimesAgreeAfterThePartitions) {
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    random_.seed(seed);
    machines_.clear();
    cuts_.clear();
    // Two sessions begin separately.
    for (std::size_t at = 0; at < 6; ++at) {
      for (std::size_t other = 0; other < at; ++other)
        if (at % 2 != other % 2) cut(at, other);
      start(at + 1, role_of(at), random_());
      run(static_cast<std::int64_t>(random_() % 3000));
    }
    for (std::size_t at = 0; at < 6; ++at) program(at).force_on = random_() % 2 == 0;
    for (int round = 0; round < 40; ++round) {
      apply_random_event();
      run(static_cast<std::int64_t>(random_() % 2000));
    }
    cuts_.clear();
    run(5'000);
    for (Machine& machine : machines_) {
      ASSERT_LE(machine.max_step_ns, kSlewedNs) << "seed " << seed;
      if (machine.program != nullptr) machine.program->force_on = false;
    }
    run(10'000);
    std::set<std::uint64_t> references;
    std::int64_t min_ns = INT64_MAX, max_ns = INT64_MIN;
    for (std::size_t at = 0; at < machines_.size(); ++at) {
      if (machines_[at].program == nullptr) continue;
      references.insert(reference(at));
      min_ns = std::min(min_ns, session(at));
      max_ns = std::max(max_ns, session(at));
    }
    ASSERT_LE(references.size(), 1u) << "seed " << seed;
    if (!references.empty()) {
      ASSERT_LT(max_ns - min_ns, kMs) << "seed " << seed;
    }
  }
}

}  // namespace
}  // namespace tactus::session
