// Why a cycle was late: the classifier against histories whose causes are known, and against causes that are planted in
// the real haptic thread.

#include "hrtc_service/late_cycles.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
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

#include "hrtc_service/haptic_thread.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kUs = 1000, kMs = 1'000'000;
constexpr std::int64_t kPeriod = kMs;

// ---- histories whose causes are known

/// What a thread does, and what the system counts of it, piece by piece.
class History {
 public:
  enum Kind : std::uint8_t { kSleeps, kIntervals, kWaits, kBlocks, kUnaccounted };
  struct Piece {
    Kind kind;
    std::int64_t ns;
  };

  /// A cycle: what happens from when it is due until it begins, and then until it ends. Returns its times.
  CycleTimes cycle(const std::vector<Piece>& wake, const std::vector<Piece>& work) {
    const std::int64_t due_ns = next_due_ns_ + std::max<std::int64_t>(0, now_ns_ - next_due_ns_) / kPeriod * kPeriod;
    next_due_ns_ = due_ns + kPeriod;
    if (now_ns_ < due_ns) {
      add({kSleeps, due_ns - now_ns_});
      for (const Piece& piece : wake) add(piece);
    }
    const std::int64_t began_ns = now_ns_;
    for (const Piece& piece : work) add(piece);
    return {due_ns, began_ns, now_ns_, next_due_ns_};
  }
  /// What would be read at `time_ns`.
  [[nodiscard]] ThreadUsage usage(std::int64_t time_ns) const {
    ThreadUsage usage;
    usage.counted_ns = usage.time_ns = time_ns;
    usage.asleep = true;
    for (const auto& [kind, from_ns, to_ns] : pieces_) {
      const std::int64_t ns = std::clamp<std::int64_t>(time_ns - from_ns, 0, to_ns - from_ns);
      if (kind == kIntervals) usage.cpu_ns += ns;
      if (kind == kWaits) usage.wait_ns += ns;
      if (kind != kSleeps && from_ns < time_ns && time_ns < to_ns) usage.asleep = false;
      if ((kind == kSleeps || kind == kBlocks) && time_ns > from_ns) ++usage.voluntary;
    }
    return usage;
  }
  [[nodiscard]] std::int64_t now_ns() const { return now_ns_; }

 private:
  struct Placed {
    Kind kind;
    std::int64_t from_ns, to_ns;
  };
  void add(const Piece& piece) {
    pieces_.push_back({piece.kind, now_ns_, now_ns_ + piece.ns});
    now_ns_ += piece.ns;
  }

  std::int64_t now_ns_ = 0, next_due_ns_ = kPeriod;
  std::vector<Placed> pieces_;
};

/// Quiet cycles, the given one, and more quiet ones; readings where the thread is asleep, every `readings` cycles.
/// Returns the classes of all late cycles.
std::vector<LateClass> classes_of(const std::vector<History::Piece>& wake, const std::vector<History::Piece>& work,
                                  std::int64_t readings = 1) {
  History history;
  std::vector<CycleTimes> cycles;
  const auto quiet = [&] {
    for (int i = 0; i < 8; ++i)
      cycles.push_back(history.cycle({{History::kWaits, 20 * kUs}}, {{History::kIntervals, 60 * kUs}}));
  };
  quiet();
  cycles.push_back(history.cycle(wake, work));
  quiet();
  LateCycleClassifier classifier;
  for (std::int64_t ms = 0; ms * kMs < history.now_ns(); ms += readings)
    classifier.add(history.usage(ms * kMs + 700 * kUs));
  for (const CycleTimes& cycle : cycles) classifier.add(cycle);
  classifier.finish();
  std::vector<LateClass> classes;
  while (const auto verdict = classifier.next()) classes.push_back(verdict->late_class);
  return classes;
}

using testing::Each;
using testing::ElementsAre;
using testing::IsEmpty;

TEST(LateCycles, ACycleInTimeHasNoVerdict) {
  EXPECT_THAT(classes_of({{History::kWaits, 500 * kUs}}, {{History::kIntervals, 400 * kUs}}), IsEmpty());
}

TEST(LateCycles, LongComputationIsAnOverrun) {
  EXPECT_THAT(classes_of({}, {{History::kIntervals, 1100 * kUs}}), ElementsAre(LateClass::kOverrun));
  EXPECT_THAT(classes_of({}, {{History::kIntervals, 1100 * kUs}}, 4), ElementsAre(LateClass::kOverrun));
}

TEST(LateCycles, ABlockedCycleIsAnOverrunThoughItTakesNoCpuTime) {
  const std::vector<History::Piece> blocked{
      {History::kIntervals, 30 * kUs}, {History::kBlocks, 1500 * kUs}, {History::kWaits, 10 * kUs}};
  EXPECT_THAT(classes_of({{History::kWaits, 20 * kUs}}, blocked), ElementsAre(LateClass::kOverrun));
  EXPECT_THAT(classes_of({{History::kWaits, 20 * kUs}}, blocked, 4), ElementsAre(LateClass::kOverrun));
}

TEST(LateCycles, ACycleThatWaitedForOtherThreadsIsPreempted) {
  const std::vector<History::Piece> interrupted{
      {History::kIntervals, 30 * kUs}, {History::kWaits, 1500 * kUs}, {History::kIntervals, 30 * kUs}};
  for (const std::int64_t readings : {1, 4}) {
    EXPECT_THAT(classes_of({}, interrupted, readings), ElementsAre(LateClass::kPreempted));
    EXPECT_THAT(classes_of({{History::kWaits, 970 * kUs}}, {{History::kIntervals, 60 * kUs}}, readings),
                ElementsAre(LateClass::kPreempted));
  }
}

TEST(LateCycles, TimeForWhichNothingAccountsIsUnknown) {
  const std::vector<History::Piece> unaccounted{{History::kIntervals, 30 * kUs}, {History::kUnaccounted, 1500 * kUs}};
  for (const std::int64_t readings : {1, 4}) {
    EXPECT_THAT(classes_of({{History::kUnaccounted, 970 * kUs}}, {{History::kIntervals, 60 * kUs}}, readings),
                ElementsAre(LateClass::kUnknown));
    EXPECT_THAT(classes_of({}, unaccounted, readings), ElementsAre(LateClass::kUnknown));
  }
}

TEST(LateCycles, CpuTimeThatIsChargedBeforeACycleBeginsIsUnknown) {
  EXPECT_THAT(classes_of({{History::kIntervals, 970 * kUs}}, {{History::kIntervals, 60 * kUs}}),
              ElementsAre(LateClass::kUnknown));
}

TEST(LateCycles, OwnWorkOfMoreThanHalfThePeriodIsAnOverrunWhateverElseDelayedTheCycle) {
  EXPECT_THAT(classes_of({{History::kWaits, 600 * kUs}}, {{History::kIntervals, 550 * kUs}}),
              ElementsAre(LateClass::kOverrun));
  EXPECT_THAT(classes_of({{History::kWaits, 600 * kUs}}, {{History::kIntervals, 450 * kUs}}),
              ElementsAre(LateClass::kPreempted));
}

TEST(LateCycles, ACycleThatOnlyTheOneBeforeDelayedHasItsClass) {
  EXPECT_THAT(classes_of({}, {{History::kIntervals, 1960 * kUs}}),
              ElementsAre(LateClass::kOverrun, LateClass::kOverrun));
  EXPECT_THAT(classes_of({}, {{History::kWaits, 1900 * kUs}, {History::kIntervals, 60 * kUs}}),
              ElementsAre(LateClass::kPreempted, LateClass::kPreempted));
}

TEST(LateCycles, WithoutReadingsOnBothSidesTheClassIsUnknown) {
  History history;
  LateCycleClassifier classifier;
  classifier.add(history.cycle({}, {{History::kIntervals, 1500 * kUs}}));
  classifier.add(history.usage(history.now_ns() + 1));
  classifier.add(history.cycle({}, {{History::kIntervals, 10 * kUs}}));
  classifier.add(history.cycle({}, {{History::kIntervals, 1500 * kUs}}));
  classifier.finish();
  std::vector<LateClass> classes;
  while (const auto verdict = classifier.next()) classes.push_back(verdict->late_class);
  EXPECT_THAT(classes, ElementsAre(LateClass::kUnknown, LateClass::kUnknown));
}

TEST(LateCycles, AVerdictComesAsSoonAsReadingsAllowIt) {
  History history;
  LateCycleClassifier classifier;
  classifier.add(history.usage(1));
  classifier.add(history.cycle({}, {{History::kIntervals, 1500 * kUs}}));
  EXPECT_FALSE(classifier.next().has_value());
  const std::int64_t read_ns = history.now_ns() + 100 * kUs;
  const CycleTimes later = history.cycle({}, {{History::kIntervals, 10 * kUs}});
  const CycleTimes latest = history.cycle({}, {{History::kIntervals, 10 * kUs}});
  classifier.add(history.usage(read_ns));
  EXPECT_FALSE(classifier.next().has_value());  // the thread may have blocked meanwhile
  classifier.add(later);
  classifier.add(latest);
  const auto verdict = classifier.next();
  ASSERT_TRUE(verdict.has_value());
  EXPECT_EQ(verdict->late_class, LateClass::kOverrun);
}

TEST(LateCycles, OfABlockedAndAStolenCycleBetweenTwoReadingsTheClassIsUnknown) {
  History history;
  LateCycleClassifier classifier;
  classifier.add(history.usage(0));
  std::vector<LateClass> classes;
  classifier.add(history.cycle({}, {{History::kBlocks, 1500 * kUs}}));
  for (int i = 0; i < 3; ++i) classifier.add(history.cycle({}, {{History::kIntervals, 10 * kUs}}));
  classifier.add(history.cycle({}, {{History::kUnaccounted, 1500 * kUs}}));
  for (int i = 0; i < 3; ++i) classifier.add(history.cycle({}, {{History::kIntervals, 10 * kUs}}));
  classifier.add(history.usage(history.now_ns()));
  classifier.finish();
  while (const auto verdict = classifier.next()) classes.push_back(verdict->late_class);
  EXPECT_THAT(classes, ElementsAre(LateClass::kUnknown, LateClass::kUnknown));
}

/// Cycles with random causes of random length, read at random times.
TEST(LateCycles, AClassIsNeverWrongAndSeldomUnknown) {
  std::mt19937_64 random{7};
  const auto below = [&](std::int64_t max) { return std::uniform_int_distribution<std::int64_t>{0, max}(random); };
  std::map<LateClass, int> classes;
  int known_causes = 0, known = 0;
  for (int round = 0; round < 300; ++round) {
    History history;
    LateCycleClassifier classifier;
    struct Truth {
      std::int64_t own_ns, wait_ns, lateness_ns;
      bool delayed, single;  // by the cycle before; by one cause only
    };
    std::vector<Truth> truths;
    std::vector<CycleTimes> cycles;
    for (int i = 0; i < 200; ++i) {
      const std::int64_t wait_before = below(30 * kUs), work = 20 * kUs + below(150 * kUs);
      std::int64_t runs = 0, waits = 0, blocks = 0, lost = 0, wakes = 0;
      const bool planted = i % 14 == 5;
      const std::int64_t length = planted ? below(4 * kMs) : 0, kind = below(5);
      if (planted) (kind == 0 ? runs : kind == 1 ? waits : kind == 2 ? blocks : kind == 3 ? lost : wakes) = length;
      const std::int64_t before_ns = history.now_ns();
      std::vector<History::Piece> wake{{History::kWaits, wait_before + wakes}}, pieces{{History::kIntervals, work / 2}};
      if (runs > 0) pieces.push_back({History::kIntervals, runs});
      if (waits > 0) pieces.push_back({History::kWaits, waits});
      if (blocks > 0) pieces.push_back({History::kBlocks, blocks});
      if (lost > 0) pieces.push_back({History::kUnaccounted, lost});
      pieces.push_back({History::kIntervals, work / 2});
      const CycleTimes times = history.cycle(wake, pieces);
      cycles.push_back(times);
      if (!times.late()) continue;
      const bool delayed = before_ns >= times.due_ns;
      const std::int64_t delay_ns = std::max<std::int64_t>(0, before_ns - times.due_ns);
      truths.push_back({work + runs + blocks, waits + (delayed ? 0 : wait_before + wakes),
                        times.end_ns - times.deadline_ns - delay_ns, delay_ns >= times.end_ns - times.deadline_ns,
                        !delayed && kind != 3});
    }
    for (std::int64_t time_ns = below(kMs); time_ns < history.now_ns() + 8 * kMs; time_ns += 3 * kMs + below(2 * kMs))
      classifier.add(history.usage(time_ns));
    for (const CycleTimes& cycle : cycles) classifier.add(cycle);
    classifier.finish();
    for (const Truth& truth : truths) {
      const auto verdict = classifier.next();
      ASSERT_TRUE(verdict.has_value());
      if (truth.delayed) continue;
      ++classes[verdict->late_class];
      const bool own = truth.own_ns > kPeriod / 2;
      ASSERT_TRUE(own || verdict->late_class != LateClass::kOverrun) << truth.own_ns;
      ASSERT_TRUE((!own && truth.wait_ns >= truth.lateness_ns) || verdict->late_class != LateClass::kPreempted);
      known_causes += truth.single ? 1 : 0;
      known += truth.single && verdict->late_class != LateClass::kUnknown ? 1 : 0;
    }
    EXPECT_FALSE(classifier.next().has_value());
  }
  EXPECT_GT(classes[LateClass::kOverrun], 500);
  EXPECT_GT(classes[LateClass::kPreempted], 500);
  EXPECT_GT(classes[LateClass::kUnknown], 100);
  EXPECT_GT(known, 0.85 * known_causes) << known << " of " << known_causes;
}

// ---- causes that are planted in the real haptic thread

std::int64_t thread_cpu_ns() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec * 1'000'000'000 + now.tv_nsec;
}

/// What delays a cycle: one part in the haptic thread, and one in the test's thread meanwhile.
struct Cause {
  std::function<void()> prepare = [] {};    ///< test's thread, before
  std::function<void()> in_cycle;           ///< haptic thread
  std::function<void()> meanwhile = [] {};  ///< test's thread, once `in_cycle` has begun
  std::function<void()> at_start = [] {};   ///< haptic thread, in its first cycle
};

/// A device in whose `read` the cause is planted.
class PlantedDevice final : public haptics::Device {
 public:
  explicit PlantedDevice(const Cause& cause) : cause_{cause} {}
  /// The next cycle is delayed. Returns once it has begun.
  std::int64_t plant() {
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
  bool started_ = false;  // the haptic thread's
  std::atomic<bool> armed_{false};
  std::atomic<std::int64_t> began_ns_{0};
};

constexpr std::size_t kWanted = 8, kMaxPlants = 1000;
constexpr std::int64_t kDelay = 3 * kMs;

/// The verdicts of a class.
std::vector<LateVerdict> of_class(LateClass late_class, const std::vector<LateVerdict>& verdicts) {
  std::vector<LateVerdict> found;
  std::copy_if(verdicts.begin(), verdicts.end(), std::back_inserter(found),
               [&](const LateVerdict& verdict) { return verdict.late_class == late_class; });
  return found;
}

/// Plants the cause until kWanted of its cycles are of the class that is expected: on a machine that has more to do
/// than this test, other threads delay planted cycles further, so that some are unknown. Returns the verdicts on the
/// first late cycle that each plant brought.
std::vector<LateVerdict> verdicts_on(const Cause& cause, LateClass expected) {
  HapticSettings settings;
  settings.priority = 0;
  HrtcCoreSettings core_settings;
  core_settings.pool = spm::PoolSettings::for_slots(64);
  HrtcCore core{session::Origin{1, 2, 3, 0}, core_settings};
  HapticThread haptic{settings, core.servo()};
  PlantedDevice device{cause};
  HapticCommands commands;
  commands.devices[0] = &device;
  haptic.commands().post(commands);
  (void)haptic.start();
  LateCycleClassifier classifier;
  std::vector<LateVerdict> all;
  // As the services do it, for `ns`.
  const auto watch = [&](std::int64_t ns) {
    for (const std::int64_t until_ns = monotonic_ns() + ns; monotonic_ns() < until_ns;) {
      wire::sleep_until(monotonic_ns() + kPeriod);
      haptic.usage().sample(monotonic_ns());
      for (CycleTrace trace; haptic.traces().pop(trace);) classifier.add(trace.times);
      haptic.usage().drain([&](const ThreadUsage& usage) { classifier.add(usage); });
      while (const auto verdict = classifier.next()) all.push_back(*verdict);
    }
  };
  std::vector<LateVerdict> verdicts;
  for (std::size_t plants = 0; plants < kMaxPlants && of_class(expected, verdicts).size() < kWanted; ++plants) {
    watch(15 * kMs);
    cause.prepare();
    const std::int64_t began_ns = device.plant();
    cause.meanwhile();
    watch(15 * kMs);
    const auto late = std::find_if(all.begin(), all.end(),
                                   [&](const LateVerdict& verdict) { return verdict.times.began_ns >= began_ns; });
    if (late != all.end()) verdicts.push_back(*late);
  }
  haptic.stop();
  return verdicts;
}

/// Returns the overruns.
std::vector<LateVerdict> expect_overruns(const Cause& cause) {
  const std::vector<LateVerdict> verdicts = verdicts_on(cause, LateClass::kOverrun);
  EXPECT_THAT(of_class(LateClass::kPreempted, verdicts), IsEmpty());
  std::vector<LateVerdict> overruns = of_class(LateClass::kOverrun, verdicts);
  EXPECT_GE(overruns.size(), kWanted) << "of " << verdicts.size();
  return overruns;
}

void expect_preempted(const Cause& cause) {
  const std::vector<LateVerdict> verdicts = verdicts_on(cause, LateClass::kPreempted);
  EXPECT_THAT(of_class(LateClass::kOverrun, verdicts), IsEmpty());
  EXPECT_GE(of_class(LateClass::kPreempted, verdicts).size(), kWanted) << "of " << verdicts.size();
}

/// The median over the verdicts.
template <class Figure>
std::uint64_t typical(const std::vector<LateVerdict>& verdicts, Figure figure) {
  std::vector<std::uint64_t> values;
  for (const LateVerdict& verdict : verdicts) values.push_back(verdict.*figure);
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

class PlantedCauses : public testing::Test {
 protected:
  void SetUp() override {
    const UsageSampler own{pthread_self(), gettid()};
    if (!own.available()) GTEST_SKIP() << "the kernel does not report run-queue waits (CONFIG_SCHED_INFO)";
  }
};

TEST_F(PlantedCauses, ALockThatAnotherThreadHoldsIsAnOverrun) {
  std::mutex mutex;
  Cause cause;
  cause.prepare = [&] { mutex.lock(); };
  cause.in_cycle = [&] { const std::lock_guard lock{mutex}; };
  cause.meanwhile = [&] {
    wire::sleep_until(monotonic_ns() + kDelay);
    mutex.unlock();
  };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_GE(typical(verdicts, &LateVerdict::blocked), 1u);
}

TEST_F(PlantedCauses, ASystemCallThatSleepsIsAnOverrun) {
  Cause cause;
  cause.in_cycle = [] { wire::sleep_until(monotonic_ns() + kDelay); };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_GE(typical(verdicts, &LateVerdict::blocked), 1u);
}

TEST_F(PlantedCauses, PageFaultsAreAnOverrun) {
  constexpr std::size_t kBytes = 1u << 22, kPage = 4096;
  void* const memory = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  (void)madvise(memory, kBytes, MADV_NOHUGEPAGE);
  auto* const bytes = static_cast<volatile unsigned char*>(memory);
  Cause cause;
  cause.in_cycle = [&] {
    for (const std::int64_t until_ns = thread_cpu_ns() + kDelay; thread_cpu_ns() < until_ns;) {
      (void)madvise(memory, kBytes, MADV_DONTNEED);
      for (std::size_t at = 0; at < kBytes; at += kPage) bytes[at] = 1;
    }
  };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_GE(typical(verdicts, &LateVerdict::minor_faults), kBytes / kPage);
  munmap(memory, kBytes);
}

TEST_F(PlantedCauses, LongComputationIsAnOverrun) {
  Cause cause;
  cause.in_cycle = [] {
    for (const std::int64_t until_ns = thread_cpu_ns() + kDelay; thread_cpu_ns() < until_ns;) {
    }
  };
  const std::vector<LateVerdict> verdicts = expect_overruns(cause);
  EXPECT_EQ(typical(verdicts, &LateVerdict::blocked), 0u);
}

/// A thread that takes the processor which the haptic thread runs on, for kDelay each time. The haptic thread has the
/// policy SCHED_IDLE, for which no right is needed.
class Competitor {
 public:
  Competitor() : thread_{[this] { run(); }} {}
  ~Competitor() {
    ended_ = true;
    thread_.join();
  }
  static void share_processor() {
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(first_processor(), &one);
    (void)pthread_setaffinity_np(pthread_self(), sizeof one, &one);
  }
  static void give_way() {
    share_processor();
    const sched_param none{};
    (void)sched_setscheduler(0, SCHED_IDLE, &none);
  }
  /// `wait_ns` from now it begins.
  void begin(std::int64_t wait_ns) { begin_ns_ = monotonic_ns() + wait_ns; }
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
      wire::sleep_until(monotonic_ns() + 50 * kUs);
      std::int64_t begin_ns = begin_ns_;
      if (monotonic_ns() < begin_ns) continue;
      for (const std::int64_t until_ns = monotonic_ns() + kDelay; monotonic_ns() < until_ns;) {
      }
      begin_ns_.compare_exchange_strong(begin_ns, kNever);
    }
  }
  std::atomic<bool> ended_{false};
  std::atomic<std::int64_t> begin_ns_{kNever};
  std::thread thread_;
};

TEST_F(PlantedCauses, AThreadThatTakesTheProcessorInACycleIsPreemption) {
  Competitor competitor;
  Cause cause;
  cause.at_start = Competitor::give_way;
  cause.in_cycle = [&] {
    competitor.begin(0);
    // On a busy machine the competitor may come late; the cycle's own work stays short all the same.
    for (const std::int64_t until_ns = thread_cpu_ns() + 200 * kUs; !competitor.done() && thread_cpu_ns() < until_ns;) {
    }
  };
  expect_preempted(cause);
}

TEST_F(PlantedCauses, AThreadThatHasTheProcessorWhenACycleIsDueIsPreemption) {
  Competitor competitor;
  Cause cause;
  cause.at_start = Competitor::give_way;
  cause.in_cycle = [&] { competitor.begin(kPeriod / 2); };
  expect_preempted(cause);
}

}  // namespace
}  // namespace tactus::hrtc_service
