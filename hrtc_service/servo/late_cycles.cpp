#include "hrtc_service/servo/late_cycles.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <string>
#include <string_view>

#include "realtime/periodic_clock.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMaxReadingNs = 20'000;  // max duration of reading the times
constexpr std::int64_t kMaxCountsNs = 500'000;  // max time from reading the counts to reading the times
constexpr std::int64_t kMaxSwitchNs = 20'000;   // max time from the end of a cycle until the kernel counts its sleep
constexpr int kMaxTries = 3;
constexpr std::size_t kMaxCycles = 8192;  // max stored cycles

int open_file(pid_t thread_id, const char* name) {
  const std::string path = "/proc/self/task/" + std::to_string(thread_id) + "/" + name;
  return open(path.c_str(), O_RDONLY | O_CLOEXEC);
}

/// Returns the first bytes of a file of /proc.
template <std::size_t kBytes>
std::string_view contents(int file, std::array<char, kBytes>& buffer) {
  const ssize_t bytes = file < 0 ? -1 : pread(file, buffer.data(), buffer.size(), 0);
  return {buffer.data(), bytes < 0 ? 0 : static_cast<std::size_t>(bytes)};
}

/// Removes the number at the start of `text`, after blanks, and returns it.
template <class Number>
bool parse_number(std::string_view& text, Number& number) {
  text.remove_prefix(std::min(text.find_first_not_of(" \t"), text.size()));
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return error == std::errc{};
}

bool number_after(std::string_view text, std::string_view label, std::uint64_t& number) {
  const std::size_t at = text.find(label);
  if (at == std::string_view::npos) return false;
  text.remove_prefix(at + label.size());
  return parse_number(text, number);
}

/// Returns the length of the part of [from, to] that is within [first, last].
std::int64_t overlap(std::int64_t from, std::int64_t to, std::int64_t first, std::int64_t last) {
  return std::max<std::int64_t>(0, std::min(to, last) - std::max(from, first));
}

}  // namespace

UsageSampler::UsageSampler(pthread_t thread, pid_t thread_id)
    : status_{open_file(thread_id, "status")},
      stat_{open_file(thread_id, "stat")},
      schedstat_{open_file(thread_id, "schedstat")} {
  if (pthread_getcpuclockid(thread, &cpu_clock_) != 0) cpu_clock_ = -1;
}

UsageSampler::~UsageSampler() {
  for (const int file : {status_, stat_, schedstat_})
    if (file >= 0) close(file);
}

bool UsageSampler::read_counts(ThreadUsage& usage) const {
  std::array<char, 4096> buffer;
  // The file `stat` is "pid (name) state" and numbers. The name may contain blanks. Counted from pid, field 10 has the
  // minor faults and field 12 the major faults. `stat` is read before `status`, so that `status` counts the switch into
  // the sleep that `stat` shows.
  std::string_view stat = contents(stat_, buffer);
  const std::size_t name_end = stat.rfind(") ");
  if (name_end == std::string_view::npos) return false;
  stat.remove_prefix(name_end + 2);
  usage.asleep = !stat.empty() && stat.front() == 'S';
  stat.remove_prefix(std::min<std::size_t>(1, stat.size()));
  std::int64_t other = 0;
  for (int field = 4; field < 10; ++field)
    if (!parse_number(stat, other)) return false;
  if (!parse_number(stat, usage.minor_faults) || !parse_number(stat, other) || !parse_number(stat, usage.major_faults))
    return false;
  const std::string_view status = contents(status_, buffer);
  return number_after(status, "\nvoluntary_ctxt_switches:", usage.voluntary) &&
         number_after(status, "\nnonvoluntary_ctxt_switches:", usage.involuntary);
}

bool UsageSampler::read_times(Reading& reading) const {
  std::array<char, 128> buffer;
  ThreadUsage& usage = reading.usage;
  for (int i = 0; i < kMaxTries && !reading.is_consistent; ++i) {
    const std::int64_t before_ns = realtime::monotonic_ns();
    timespec cpu{};
    if (clock_gettime(cpu_clock_, &cpu) != 0) return false;
    std::string_view schedstat = contents(schedstat_, buffer);
    const std::int64_t after_ns = realtime::monotonic_ns();
    std::uint64_t ran = 0, waited = 0, times_run = 0;
    if (!parse_number(schedstat, ran) || !parse_number(schedstat, waited) || !parse_number(schedstat, times_run) ||
        times_run == 0)
      return false;
    usage.cpu_ns = cpu.tv_sec * 1'000'000'000 + cpu.tv_nsec;
    usage.wait_ns = static_cast<std::int64_t>(waited);
    usage.time_ns = before_ns + (after_ns - before_ns) / 2;
    reading.is_consistent = after_ns - before_ns < kMaxReadingNs && usage.time_ns - usage.counted_ns < kMaxCountsNs;
  }
  return true;
}

std::optional<UsageSampler::Reading> UsageSampler::read() const {
  Reading reading;
  reading.usage.counted_ns = realtime::monotonic_ns();
  if (!read_counts(reading.usage) || !read_times(reading)) return std::nullopt;
  return reading;
}

void UsageSampler::sample(std::int64_t now_ns) {
  if (now_ns - sampled_ns_ < kPeriodNs) return;
  const std::optional<Reading> reading = read();
  if (!reading || !reading->is_consistent || (!reading->usage.asleep && now_ns - sampled_ns_ < kMaxPeriodNs)) return;
  sampled_ns_ = now_ns;
  (void)usages_.push(reading->usage);
}

void LateCycleClassifier::add(const CycleTimes& cycle) {
  const Cycle added{cycle, newest_ ? newest_->end_ns : cycle.due_ns - 1};
  // If this cycle does not follow the newest one, and that one was not late, cycles are missing. Readings from before
  // the gap cannot be compared with later ones.
  if (newest_ && !newest_->late() && cycle.due_ns > newest_->deadline_ns) {
    cycles_.clear();
    while (!usages_.empty() && usages_.front().time_ns < cycle.due_ns) usages_.pop_front();
  }
  newest_ = cycle;
  cycles_.push_back(added);
  if (cycle.late()) late_.push_back(added);
  if (cycles_.size() > kMaxCycles) cycles_.pop_front();
}

void LateCycleClassifier::drop_before(std::int64_t time_ns) {
  while (usages_.size() > 1 && usages_[1].time_ns <= time_ns) usages_.pop_front();
  const std::int64_t needed_ns = usages_.empty() ? time_ns : std::min(time_ns, usages_.front().time_ns);
  while (!cycles_.empty() && cycles_.front().times.end_ns < needed_ns - kMaxSwitchNs) cycles_.pop_front();
}

std::optional<LateVerdict> LateCycleClassifier::next() {
  if (late_.empty()) {
    if (newest_) drop_before(newest_->end_ns);
    return std::nullopt;
  }
  const Cycle late = late_.front();
  const auto after = std::find_if(usages_.begin(), usages_.end(),
                                  [&](const ThreadUsage& usage) { return usage.time_ns >= late.times.end_ns; });
  const bool was_dropped = cycles_.front().times.due_ns > late.times.due_ns;
  // The cycles up to the second reading must be known, too.
  const bool is_covered = after != usages_.end() && newest_->end_ns >= after->time_ns;
  if (!is_covered && !finished_ && !was_dropped) return std::nullopt;
  LateVerdict verdict;
  const std::int64_t from_ns = late.start_ns();
  if (late.delay_ns() >= late.times.end_ns - late.times.deadline_ns) {
    verdict.late_class = last_class_;  // it would have been in time if the previous cycle had been
  } else if (after != usages_.end() && after != usages_.begin() && usages_.front().time_ns <= from_ns && !was_dropped) {
    const auto before = std::find_if(std::make_reverse_iterator(after), usages_.rend(),
                                     [&](const ThreadUsage& usage) { return usage.time_ns <= from_ns; });
    verdict = classify(late, *before, *after);
  }
  verdict.times = late.times;
  last_class_ = verdict.late_class;
  late_.pop_front();
  drop_before(late_.empty() ? newest_->end_ns : late_.front().times.due_ns);
  return verdict;
}

LateVerdict LateCycleClassifier::classify(const Cycle& late, const ThreadUsage& before,
                                          const ThreadUsage& after) const {
  // Sums over the cycles between the readings:
  // wake_ns: time in which a cycle was due and the previous one had ended, but the cycle had not begun.
  // awake_ns: time from the begin to the end of a cycle.
  // Both consist of CPU time, run-queue wait, blocking, and unaccounted time (a late timer, a hypervisor).
  std::int64_t wake_ns = 0, awake_ns = 0;
  std::int64_t longest_other_ns = 0;
  std::int64_t sleeps_min = 0, sleeps_max = 0;
  for (const Cycle& cycle : cycles_) {
    wake_ns += overlap(cycle.start_ns(), cycle.times.began_ns, before.time_ns, after.time_ns);
    const std::int64_t cycle_awake_ns =
        overlap(cycle.times.began_ns, cycle.times.end_ns, before.time_ns, after.time_ns);
    awake_ns += cycle_awake_ns;
    if (cycle.times.due_ns != late.times.due_ns) longest_other_ns = std::max(longest_other_ns, cycle_awake_ns);
    if (cycle.follows_without_sleep()) continue;
    const std::int64_t sleep_ns = cycle.previous_end_ns, latest_switch_ns = sleep_ns + kMaxSwitchNs;
    if (sleep_ns > before.time_ns && latest_switch_ns < after.counted_ns) ++sleeps_min;
    if (latest_switch_ns > before.counted_ns && sleep_ns < after.time_ns) ++sleeps_max;
  }
  if (!before.asleep || newest_->end_ns < after.time_ns) ++sleeps_max;
  if (!after.asleep) --sleeps_min;
  const std::int64_t half_ns = (late.times.deadline_ns - late.times.due_ns) / 2;
  const std::int64_t late_awake_ns = late.times.end_ns - late.times.began_ns;
  const std::int64_t late_wake_ns = late.times.began_ns - late.start_ns();
  const std::int64_t other_awake_ns = awake_ns - late_awake_ns;

  LateVerdict verdict;
  verdict.cpu_ns = after.cpu_ns - before.cpu_ns;
  verdict.wait_ns = after.wait_ns - before.wait_ns;
  verdict.minor_faults = after.minor_faults - before.minor_faults;
  verdict.major_faults = after.major_faults - before.major_faults;
  const auto switches = static_cast<std::int64_t>(after.voluntary - before.voluntary);
  const bool may_have_blocked = switches > sleeps_min;
  verdict.blocked = static_cast<std::uint64_t>(std::max<std::int64_t>(0, switches - sleeps_max));
  // How long the thread was blocked is unknown. Blocking explains the late cycle only if no other cycle was long.
  const bool has_blocked = verdict.blocked > 0 && longest_other_ns <= half_ns;

  // Foreign time is the part of awake_ns that is neither CPU time nor blocking. If the thread did not block, it is all
  // time off the CPU. Otherwise it is at most the run-queue wait, and at least the run-queue wait minus wake_ns.
  const std::int64_t off_cpu_ns = std::max<std::int64_t>(0, awake_ns - verdict.cpu_ns);
  const std::int64_t foreign_min_ns =
      may_have_blocked ? std::clamp<std::int64_t>(verdict.wait_ns - wake_ns, 0, off_cpu_ns) : off_cpu_ns;
  const std::int64_t foreign_max_ns = has_blocked ? std::min(verdict.wait_ns, off_cpu_ns) : off_cpu_ns;
  const std::int64_t late_foreign_ns = std::max<std::int64_t>(0, foreign_min_ns - other_awake_ns);
  verdict.own_ns = std::max<std::int64_t>(0, late_awake_ns - foreign_max_ns);
  const std::int64_t own_max_ns = late_awake_ns - late_foreign_ns;

  if (verdict.own_ns > half_ns) {
    verdict.late_class = LateClass::kOverrun;
    return verdict;
  }
  if (own_max_ns > half_ns) return verdict;
  // The late cycle's own time does not explain why it is late. Its run-queue wait is at least its wake time plus its
  // foreign time, minus all unaccounted time between the readings. CPU time beyond awake_ns was counted before the
  // thread ran: interrupts, or a hypervisor.
  const std::int64_t unaccounted_ns =
      std::max<std::int64_t>(0, wake_ns + awake_ns - std::min(verdict.cpu_ns, awake_ns) - verdict.wait_ns);
  const std::int64_t unaccounted_max_ns = has_blocked ? std::min(unaccounted_ns, wake_ns) : unaccounted_ns;
  const std::int64_t late_wait_ns = late_wake_ns + late_foreign_ns - unaccounted_max_ns;
  const std::int64_t lateness_ns = late.times.end_ns - late.times.deadline_ns - late.delay_ns();
  if (late_wait_ns >= lateness_ns) verdict.late_class = LateClass::kPreempted;
  return verdict;
}

}  // namespace tactus::hrtc_service
