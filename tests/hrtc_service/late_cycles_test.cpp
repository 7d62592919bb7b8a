// Checks the classes of late cycles whose causes are known: in simulated histories, and after delays that the test
// causes in the real haptic thread.

#include "hrtc_service/servo/late_cycles.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <ctime>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <mutex>
#include <random>
#include <thread>
#include <vector>

#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/servo/haptic_thread.hpp"
#include "realtime/periodic_clock.hpp"
#include "tests/support/constants.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kPeriod = kMs;

// ---- simulated histories

/// Simulates the activities of a periodic thread and the system's counters for it.
class History {
 public:
  enum Kind : std::uint8_t {
    kSleeps,      ///< until the next cycle is due
    kComputes,    ///< has a processor
    kWaits,       ///< is runnable while another thread has the processor
    kBlocks,      ///< on a lock or in a system call
    kUnaccounted  ///< no counter of the system grows
  };
  struct Activity {
    Kind kind;
    std::int64_t ns;
  };

  /// Adds a cycle. `wake`: activities from the due time to the start; left out if the previous cycle ends after the due
  /// time. `work`: activities from the start to the end.
  CycleTimes cycle(const std::vector<Activity>& wake, const std::vector<Activity>& work) {
    const std::int64_t due_ns = next_due_ns_ + std::max<std::int64_t>(0, now_ns_ - next_due_ns_) / kPeriod * kPeriod;
    next_due_ns_ = due_ns + kPeriod;
    if (now_ns_ < due_ns) {
      add({kSleeps, due_ns - now_ns_});
      for (const Activity& activity : wake) add(activity);
    }
    const std::int64_t began_ns = now_ns_;
    for (const Activity& activity : work) add(activity);
    return {due_ns, began_ns, now_ns_, next_due_ns_};
  }
  /// Returns the counters at `time_ns`.
  [[nodiscard]] ThreadUsage usage(std::int64_t time_ns) const {
    ThreadUsage usage;
    usage.counted_ns = usage.time_ns = time_ns;
    usage.asleep = true;
    for (const auto& [kind, from_ns, to_ns] : history_) {
      const std::int64_t ns = std::clamp<std::int64_t>(time_ns - from_ns, 0, to_ns - from_ns);
      if (kind == kComputes) usage.cpu_ns += ns;
      if (kind == kWaits) usage.wait_ns += ns;
      if (kind != kSleeps && from_ns < time_ns && time_ns < to_ns) usage.asleep = false;
      if ((kind == kSleeps || kind == kBlocks) && time_ns > from_ns) ++usage.voluntary;
    }
    return usage;
  }
  [[nodiscard]] std::int64_t now_ns() const { return now_ns_; }

 private:
  struct TimedActivity {
    Kind kind;
    std::int64_t from_ns, to_ns;
  };
  void add(const Activity& activity) {
    history_.push_back({activity.kind, now_ns_, now_ns_ + activity.ns});
    now_ns_ += activity.ns;
  }

  std::int64_t now_ns_ = 0, next_due_ns_ = kPeriod;
  std::vector<TimedActivity> history_;
};

std::vector<LateClass> classes_of(LateCycleClassifier& classifier) {
  classifier.finish();
  std::vector<LateClass> classes;
  while (const auto verdict = classifier.next()) classes.push_back(verdict->late_class);
  return classes;
}

/// Returns the classes of all late cycles in a history of short cycles with the given cycle in the middle. The counters
/// are read while the thread sleeps, every `read_period` cycles.
std::vector<LateClass> classes_of(const std::vector<History::Activity>& wake,
                                  const std::vector<History::Activity>& work, std::int64_t read_period = 1) {
  History history;
  std::vector<CycleTimes> cycles;
  const auto add_short_cycles = [&] {
    for (int i = 0; i < 8; ++i)
      cycles.push_back(history.cycle({{History::kWaits, 20 * kUs}}, {{History::kComputes, 60 * kUs}}));
  };
  add_short_cycles();
  cycles.push_back(history.cycle(wake, work));
  add_short_cycles();
  LateCycleClassifier classifier;
  for (std::int64_t ms = 0; ms * kMs < history.now_ns(); ms += read_period)
    classifier.add(history.usage(ms * kMs + 700 * kUs));
  for (const CycleTimes& cycle : cycles) classifier.add(cycle);
  return classes_of(classifier);
}

using testing::ElementsAre;
using testing::IsEmpty;

TEST(LateCycles, ACycleInTimeHasNoVerdict) {
  EXPECT_THAT(classes_of({{History::kWaits, 500 * kUs}}, {{History::kComputes, 400 * kUs}}), IsEmpty());
}

TEST(LateCycles, LongComputationIsAnOverrun) {
  EXPECT_THAT(classes_of({}, {{History::kComputes, 1100 * kUs}}), ElementsAre(LateClass::kOverrun));
  EXPECT_THAT(classes_of({}, {{History::kComputes, 1100 * kUs}}, 4), ElementsAre(LateClass::kOverrun));
}

TEST(LateCycles, ABlockedCycleIsAnOverrunAlthoughItUsesNoCpuTime) {
  const std::vector<History::Activity> blocked{
      {History::kComputes, 30 * kUs}, {History::kBlocks, 1500 * kUs}, {History::kWaits, 10 * kUs}};
  EXPECT_THAT(classes_of({{History::kWaits, 20 * kUs}}, blocked), ElementsAre(LateClass::kOverrun));
  EXPECT_THAT(classes_of({{History::kWaits, 20 * kUs}}, blocked, 4), ElementsAre(LateClass::kOverrun));
}

TEST(LateCycles, ACycleThatWaitedForOtherThreadsIsPreempted) {
  const std::vector<History::Activity> interrupted{
      {History::kComputes, 30 * kUs}, {History::kWaits, 1500 * kUs}, {History::kComputes, 30 * kUs}};
  for (const std::int64_t readings : {1, 4}) {
    EXPECT_THAT(classes_of({}, interrupted, readings), ElementsAre(LateClass::kPreempted));
    EXPECT_THAT(classes_of({{History::kWaits, 970 * kUs}}, {{History::kComputes, 60 * kUs}}, readings),
                ElementsAre(LateClass::kPreempted));
  }
}

TEST(LateCycles, ACycleWithADelayThatNoCounterShowsIsUnknown) {
  const std::vector<History::Activity> unaccounted{{History::kComputes, 30 * kUs}, {History::kUnaccounted, 1500 * kUs}};
  for (const std::int64_t readings : {1, 4}) {
    EXPECT_THAT(classes_of({{History::kUnaccounted, 970 * kUs}}, {{History::kComputes, 60 * kUs}}, readings),
                ElementsAre(LateClass::kUnknown));
    EXPECT_THAT(classes_of({}, unaccounted, readings), ElementsAre(LateClass::kUnknown));
  }
}

TEST(LateCycles, ACycleWithCpuTimeBeforeItsStartIsUnknown) {
  EXPECT_THAT(classes_of({{History::kComputes, 970 * kUs}}, {{History::kComputes, 60 * kUs}}),
              ElementsAre(LateClass::kUnknown));
}

TEST(LateCycles, ACycleWithOwnWorkOfMoreThanHalfThePeriodIsAnOverrunAlsoAfterOtherDelays) {
  EXPECT_THAT(classes_of({{History::kWaits, 600 * kUs}}, {{History::kComputes, 550 * kUs}}),
              ElementsAre(LateClass::kOverrun));
  EXPECT_THAT(classes_of({{History::kWaits, 600 * kUs}}, {{History::kComputes, 450 * kUs}}),
              ElementsAre(LateClass::kPreempted));
}

TEST(LateCycles, ACycleThatOnlyThePreviousCycleDelayedHasTheClassOfThatCycle) {
  EXPECT_THAT(classes_of({}, {{History::kComputes, 1960 * kUs}}),
              ElementsAre(LateClass::kOverrun, LateClass::kOverrun));
  EXPECT_THAT(classes_of({}, {{History::kWaits, 1900 * kUs}, {History::kComputes, 60 * kUs}}),
              ElementsAre(LateClass::kPreempted, LateClass::kPreempted));
}

TEST(LateCycles, ALateCycleWithoutReadingsBeforeAndAfterItIsUnknown) {
  History history;
  LateCycleClassifier classifier;
  classifier.add(history.cycle({}, {{History::kComputes, 1500 * kUs}}));
  classifier.add(history.usage(history.now_ns() + 1));
  classifier.add(history.cycle({}, {{History::kComputes, 10 * kUs}}));
  classifier.add(history.cycle({}, {{History::kComputes, 1500 * kUs}}));
  EXPECT_THAT(classes_of(classifier), ElementsAre(LateClass::kUnknown, LateClass::kUnknown));
}

TEST(LateCycles, AVerdictIsReturnedOnceTheCyclesUpToTheReadingAreAdded) {
  History history;
  LateCycleClassifier classifier;
  classifier.add(history.usage(1));
  classifier.add(history.cycle({}, {{History::kComputes, 1500 * kUs}}));
  EXPECT_FALSE(classifier.next().has_value());
  const std::int64_t read_ns = history.now_ns() + 100 * kUs;
  const CycleTimes later = history.cycle({}, {{History::kComputes, 10 * kUs}});
  const CycleTimes latest = history.cycle({}, {{History::kComputes, 10 * kUs}});
  classifier.add(history.usage(read_ns));
  EXPECT_FALSE(classifier.next().has_value());  // the thread may have blocked before the reading
  classifier.add(later);
  classifier.add(latest);
  const auto verdict = classifier.next();
  ASSERT_TRUE(verdict.has_value());
  EXPECT_EQ(verdict->late_class, LateClass::kOverrun);
}

TEST(LateCycles, ABlockedAndADelayedCycleBetweenTwoReadingsAreUnknown) {
  History history;
  LateCycleClassifier classifier;
  classifier.add(history.usage(0));
  classifier.add(history.cycle({}, {{History::kBlocks, 1500 * kUs}}));
  for (int i = 0; i < 3; ++i) classifier.add(history.cycle({}, {{History::kComputes, 10 * kUs}}));
  classifier.add(history.cycle({}, {{History::kUnaccounted, 1500 * kUs}}));
  for (int i = 0; i < 3; ++i) classifier.add(history.cycle({}, {{History::kComputes, 10 * kUs}}));
  classifier.add(history.usage(history.now_ns()));
  EXPECT_THAT(classes_of(classifier), ElementsAre(LateClass::kUnknown, LateClass::kUnknown));
}

/// A random cycle of a history, with the times that the classifier should find.
struct RandomCycle {
  CycleTimes times;
  std::int64_t own_ns = 0, wait_ns = 0;
  std::int64_t lateness_ns = 0;              ///< without the delay by the previous cycle
  bool only_previous_cycle_delayed = false;  ///< the cycle would not be late without the delay by the previous cycle
  bool is_clear = false;                     ///< it has one cause, which the counters show
};

/// Adds a cycle with random times to `history`. `delayed`: adds a delay of random length and kind. `below`: returns a
/// random number up to its argument.
template <class Below>
RandomCycle add_random_cycle(History& history, Below&& below, bool delayed) {
  constexpr std::array kDelays{History::kComputes, History::kWaits, History::kBlocks, History::kUnaccounted};
  const std::int64_t usual_wait_ns = below(30 * kUs), work_ns = 20 * kUs + below(150 * kUs);
  const std::int64_t extra_ns = delayed ? below(4 * kMs) : 0;
  const auto kind = static_cast<std::size_t>(below(5));
  const bool delays_work = kind < kDelays.size();
  const std::int64_t wake_wait_ns = usual_wait_ns + (delays_work ? 0 : extra_ns);
  std::vector<History::Activity> work{{History::kComputes, work_ns / 2}};
  if (delays_work && extra_ns > 0) work.push_back({kDelays[kind], extra_ns});
  work.push_back({History::kComputes, work_ns / 2});
  const auto extra_of = [&](History::Kind delay) { return delays_work && kDelays[kind] == delay ? extra_ns : 0; };

  const std::int64_t previous_end_ns = history.now_ns();
  RandomCycle cycle;
  cycle.times = history.cycle({{History::kWaits, wake_wait_ns}}, work);
  const bool has_slept = previous_end_ns < cycle.times.due_ns;
  const std::int64_t delay_ns = std::max<std::int64_t>(0, previous_end_ns - cycle.times.due_ns);
  cycle.own_ns = work_ns + extra_of(History::kComputes) + extra_of(History::kBlocks);
  cycle.wait_ns = extra_of(History::kWaits) + (has_slept ? wake_wait_ns : 0);
  cycle.lateness_ns = cycle.times.end_ns - cycle.times.deadline_ns - delay_ns;
  cycle.only_previous_cycle_delayed = cycle.lateness_ns <= 0;
  cycle.is_clear = has_slept && !(delays_work && kDelays[kind] == History::kUnaccounted);
  return cycle;
}

TEST(LateCycles, AClassIsNeverWrongAndSeldomUnknownForRandomCyclesAndReadings) {
  std::mt19937_64 random{7};
  const auto below = [&](std::int64_t max) { return std::uniform_int_distribution<std::int64_t>{0, max}(random); };
  std::map<LateClass, int> classes;
  int clear = 0, clear_and_known = 0;
  for (int round = 0; round < 300; ++round) {
    History history;
    LateCycleClassifier classifier;
    std::vector<RandomCycle> cycles;
    for (int i = 0; i < 200; ++i) cycles.push_back(add_random_cycle(history, below, i % 14 == 5));
    for (std::int64_t time_ns = below(kMs); time_ns < history.now_ns() + 8 * kMs; time_ns += 3 * kMs + below(2 * kMs))
      classifier.add(history.usage(time_ns));
    for (const RandomCycle& cycle : cycles) classifier.add(cycle.times);
    classifier.finish();
    for (const RandomCycle& cycle : cycles) {
      if (!cycle.times.late()) continue;
      const auto verdict = classifier.next();
      ASSERT_TRUE(verdict.has_value());
      if (cycle.only_previous_cycle_delayed) continue;
      ++classes[verdict->late_class];
      const bool overran = cycle.own_ns > kPeriod / 2;
      ASSERT_TRUE(overran || verdict->late_class != LateClass::kOverrun) << cycle.own_ns;
      ASSERT_TRUE((!overran && cycle.wait_ns >= cycle.lateness_ns) || verdict->late_class != LateClass::kPreempted);
      clear += cycle.is_clear ? 1 : 0;
      clear_and_known += cycle.is_clear && verdict->late_class != LateClass::kUnknown ? 1 : 0;
    }
    EXPECT_FALSE(classifier.next().has_value());
  }
  EXPECT_GT(classes[LateClass::kOverrun], 500);
  EXPECT_GT(classes[LateClass::kPreempted], 500);
  EXPECT_GT(classes[LateClass::kUnknown], 100);
  EXPECT_GT(clear_and_known, 0.85 * clear) << clear_and_known << " of " << clear;
}

// ---- delays that the test causes in the real haptic thread

std::int64_t thread_cpu_ns() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec * 1'000'000'000 + now.tv_nsec;
}

/// The cause of a delay: a part in the haptic thread, and parts in the test's thread.
struct Cause {
  std::function<void()> prepare = [] {};       ///< test's thread, before the cycle
  std::function<void()> in_cycle;              ///< haptic thread
  std::function<void()> during_cycle = [] {};  ///< test's thread, once `in_cycle` has begun
  std::function<void()> at_start = [] {};      ///< haptic thread, in its first cycle
};

/// A device whose `read` delays a cycle on request.
class DelayingDevice final : public haptics::Device {
 public:
  explicit DelayingDevice(const Cause& cause) : cause_{cause} {}
  /// Delays the next cycle. Waits for its start, and returns the time of its start.
  std::int64_t delay_next_cycle() {
    began_ns_ = 0;
    armed_ = true;
    while (began_ns_ == 0) std::this_thread::yield();
    return began_ns_;
  }

  [[nodiscard]] const haptics::DeviceSpec& spec() const noexcept override { return spec_; }
  [[nodiscard]] haptics::DeviceState read(std::int64_t now_ns) noexcept override {
    if (!started_) cause_.at_start();
    started_ = true;
    if (armed_.exchange(false)) {
      began_ns_ = now_ns;
      cause_.in_cycle();
    }
    haptics::DeviceState state;
    state.time_ns = now_ns;
    return state;
  }
  void write(const haptics::Vec3d&) noexcept override {}
  [[nodiscard]] haptics::DeviceHealth health() const noexcept override { return haptics::DeviceHealth::kReady; }

 private:
  const Cause& cause_;
  haptics::DeviceSpec spec_;
  bool started_ = false;  // only the haptic thread uses this
  std::atomic<bool> armed_{false};
  std::atomic<std::int64_t> began_ns_{0};
};

constexpr std::size_t kMinVerdicts = 8, kMaxAttempts = 1000;
constexpr std::int64_t kDelay = 3 * kMs;

std::vector<LateVerdict> of_class(LateClass late_class, const std::vector<LateVerdict>& verdicts) {
  std::vector<LateVerdict> found;
  std::copy_if(verdicts.begin(), verdicts.end(), std::back_inserter(found),
               [&](const LateVerdict& verdict) { return verdict.late_class == late_class; });
  return found;
}

/// Delays cycles by `cause` until kMinVerdicts of them have the class `expected`. On a busy machine, other threads also
/// delay these cycles, so that some are unknown. Returns the verdict on the first late cycle after each attempt.
std::vector<LateVerdict> verdicts_on(const Cause& cause, LateClass expected) {
  HapticSettings settings;
  settings.priority = 0;
  HrtcCoreSettings core_settings;
  core_settings.pool = spm::PoolSettings::for_slots(64);
  HrtcCore core{session::Origin{1, 2, 3, 0}, core_settings};
  DelayingDevice device{cause};
  HapticThread haptic{settings, core.servo(), core.link(), {&device}};
  RingReader traces{core.link().traces};
  (void)haptic.start();
  LateCycleClassifier classifier;
  std::vector<LateVerdict> all_verdicts;
  // Reads the counters and classifies cycles for `ns`, as the intake thread of an HRTC does.
  const auto classify_for = [&](std::int64_t ns) {
    for (const std::int64_t until_ns = realtime::monotonic_ns() + ns; realtime::monotonic_ns() < until_ns;) {
      realtime::sleep_until(realtime::monotonic_ns() + kPeriod);
      haptic.usage().sample(realtime::monotonic_ns());
      for (CycleTrace trace; traces.pop(trace);) classifier.add(trace.times);
      haptic.usage().drain([&](const ThreadUsage& usage) { classifier.add(usage); });
      while (const auto verdict = classifier.next()) all_verdicts.push_back(*verdict);
    }
  };
  std::vector<LateVerdict> verdicts;
  for (std::size_t attempts = 0; attempts < kMaxAttempts && of_class(expected, verdicts).size() < kMinVerdicts;
       ++attempts) {
    classify_for(15 * kMs);
    cause.prepare();
    const std::int64_t began_ns = device.delay_next_cycle();
    cause.during_cycle();
    classify_for(15 * kMs);
    const auto late = std::find_if(all_verdicts.begin(), all_verdicts.end(),
                                   [&](const LateVerdict& verdict) { return verdict.times.began_ns >= began_ns; });
    if (late != all_verdicts.end()) verdicts.push_back(*late);
  }
  haptic.stop();
  return verdicts;
}

/// Expects overruns and no preempted cycle. Returns the overruns.
std::vector<LateVerdict> expect_overruns(const Cause& cause) {
  const std::vector<LateVerdict> verdicts = verdicts_on(cause, LateClass::kOverrun);
  EXPECT_THAT(of_class(LateClass::kPreempted, verdicts), IsEmpty());
  std::vector<LateVerdict> overruns = of_class(LateClass::kOverrun, verdicts);
  EXPECT_GE(overruns.size(), kMinVerdicts) << "of " << verdicts.size();
  return overruns;
}

void expect_preempted(const Cause& cause) {
  const std::vector<LateVerdict> verdicts = verdicts_on(cause, LateClass::kPreempted);
  EXPECT_THAT(of_class(LateClass::kOverrun, verdicts), IsEmpty());
  EXPECT_GE(of_class(LateClass::kPreempted, verdicts).size(), kMinVerdicts) << "of " << verdicts.size();
}

/// Returns the median of a member of the verdicts.
template <class Figure>
std::uint64_t median(const std::vector<LateVerdict>& verdicts, Figure figure) {
  std::vector<std::uint64_t> values;
  for (const LateVerdict& verdict : verdicts) values.push_back(verdict.*figure);
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

class CausedDelays : public testing::Test {
 protected:
  void SetUp() override {
    const UsageSampler sampler{pthread_self(), gettid()};
    if (!sampler.available()) GTEST_SKIP() << "the kernel does not report run-queue waits (CONFIG_SCHED_INFO)";
  }
};

TEST_F(CausedDelays, AWaitForALockIsAnOverrun) {
  std::mutex mutex;
  Cause cause;
  cause.prepare = [&] { mutex.lock(); };
  cause.in_cycle = [&] { const std::lock_guard lock{mutex}; };
  cause.during_cycle = [&] {
    realtime::sleep_until(realtime::monotonic_ns() + kDelay);
    mutex.unlock();
  };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_GE(median(verdicts, &LateVerdict::blocked), 1u);
}

TEST_F(CausedDelays, ASystemCallThatSleepsIsAnOverrun) {
  Cause cause;
  cause.in_cycle = [] { realtime::sleep_until(realtime::monotonic_ns() + kDelay); };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_GE(median(verdicts, &LateVerdict::blocked), 1u);
}

TEST_F(CausedDelays, PageFaultsAreAnOverrun) {
  constexpr std::size_t kBytes = 1u << 22, kPage = 4096;
  void* const memory = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  (void)madvise(memory, kBytes, MADV_NOHUGEPAGE);
  auto* const bytes = static_cast<volatile unsigned char*>(memory);
  Cause cause;
  cause.in_cycle = [&] {
    for (const std::int64_t until_ns = thread_cpu_ns() + kDelay; thread_cpu_ns() < until_ns;) {
      (void)madvise(memory, kBytes, MADV_DONTNEED);
      for (std::size_t offset = 0; offset < kBytes; offset += kPage) bytes[offset] = 1;
    }
  };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_GE(median(verdicts, &LateVerdict::minor_faults), kBytes / kPage);
  munmap(memory, kBytes);
}

TEST_F(CausedDelays, LongComputationIsAnOverrun) {
  Cause cause;
  cause.in_cycle = [] {
    for (const std::int64_t until_ns = thread_cpu_ns() + kDelay; thread_cpu_ns() < until_ns;) {
    }
  };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_EQ(median(verdicts, &LateVerdict::blocked), 0u);
}

/// A thread that takes the processor of the haptic thread for kDelay on request. The haptic thread uses SCHED_IDLE,
/// which needs no privilege.
class Competitor {
 public:
  Competitor() : thread_{[this] { run(); }} {}
  ~Competitor() {
    ended_ = true;
    thread_.join();
  }
  static void share_processor() {
    cpu_set_t shared;
    CPU_ZERO(&shared);
    CPU_SET(first_processor(), &shared);
    (void)pthread_setaffinity_np(pthread_self(), sizeof shared, &shared);
  }
  /// Lets the calling thread share the processor with a lower priority than the competitor.
  static void yield_processor() {
    share_processor();
    const sched_param no_priority{};
    (void)sched_setscheduler(0, SCHED_IDLE, &no_priority);
  }
  /// Takes the processor after `wait_ns`.
  void begin(std::int64_t wait_ns) { begin_ns_ = realtime::monotonic_ns() + wait_ns; }
  [[nodiscard]] bool done() const { return begin_ns_ == kNever; }

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  static int first_processor() {
    cpu_set_t allowed;
    CPU_ZERO(&allowed);
    (void)sched_getaffinity(0, sizeof allowed, &allowed);
    int processor = 0;
    while (!CPU_ISSET(processor, &allowed)) ++processor;
    return processor;
  }
  void run() {
    share_processor();
    while (!ended_) {
      realtime::sleep_until(realtime::monotonic_ns() + 50 * kUs);
      std::int64_t begin_ns = begin_ns_;
      if (realtime::monotonic_ns() < begin_ns) continue;
      for (const std::int64_t until_ns = realtime::monotonic_ns() + kDelay; realtime::monotonic_ns() < until_ns;) {
      }
      begin_ns_.compare_exchange_strong(begin_ns, kNever);
    }
  }
  std::atomic<bool> ended_{false};
  std::atomic<std::int64_t> begin_ns_{kNever};
  std::thread thread_;
};

TEST_F(CausedDelays, ACycleDuringWhichAnotherThreadTakesTheProcessorIsPreempted) {
  Competitor competitor;
  Cause cause;
  cause.at_start = Competitor::yield_processor;
  cause.in_cycle = [&] {
    competitor.begin(0);
    // On a busy machine the competitor may begin late. This limit keeps the cycle's own work short.
    for (const std::int64_t until_ns = thread_cpu_ns() + 200 * kUs; !competitor.done() && thread_cpu_ns() < until_ns;) {
    }
  };
  expect_preempted(cause);
}

TEST_F(CausedDelays, ACycleThatIsDueWhileAnotherThreadHasTheProcessorIsPreempted) {
  Competitor competitor;
  Cause cause;
  cause.at_start = Competitor::yield_processor;
  cause.in_cycle = [&] { competitor.begin(kPeriod / 2); };
  expect_preempted(cause);
}

}  // namespace
}  // namespace tactus::hrtc_service
