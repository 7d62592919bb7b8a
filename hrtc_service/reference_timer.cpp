#include "hrtc_service/reference_timer.hpp"

#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <future>

#include "realtime/periodic_clock.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kWorkNs = 30'000;  // duration of the computation

}  // namespace

ReferenceTimer::ReferenceTimer(std::int64_t period_ns, int priority) {
  std::promise<pid_t> thread_id;
  thread_ = std::thread{[this, period_ns, priority, &thread_id] {
    pthread_setname_np(pthread_self(), "timer");
    if (priority > 0) (void)realtime::enter_realtime("timer", priority);
    thread_id.set_value(gettid());
    run(period_ns);
  }};
  usage_ = std::make_unique<UsageSampler>(thread_.native_handle(), thread_id.get_future().get());
}

ReferenceTimer::~ReferenceTimer() {
  running_ = false;
  thread_.join();
}

void ReferenceTimer::drain(Samples& samples) {
  for (CycleTimes cycle; cycles_.pop(cycle);) {
    samples.add(static_cast<std::uint32_t>(cycle.began_ns - cycle.due_ns));
    classifier_.add(cycle);
  }
  usage_->drain([this](const ThreadUsage& usage) { classifier_.add(usage); });
  while (const std::optional<LateVerdict> verdict = classifier_.next())
    if (verdict->late_class == LateClass::kOverrun) ++overruns_;
}

void ReferenceTimer::compute(std::uint32_t steps) noexcept {
  for (std::uint32_t i = 0; i < steps; ++i) number_ = number_ * 6364136223846793005u + 1442695040888963407u;
}

std::uint32_t ReferenceTimer::steps_for_work() noexcept {
  constexpr std::uint32_t kMeasuredSteps = 10000;
  std::int64_t min_ns = kWorkNs;
  for (int round = 0; round < 8; ++round) {
    const std::int64_t began = realtime::monotonic_ns();
    compute(kMeasuredSteps);
    min_ns = std::min(min_ns, realtime::monotonic_ns() - began);
  }
  return static_cast<std::uint32_t>(kMeasuredSteps * kWorkNs / std::max<std::int64_t>(min_ns, 1));
}

void ReferenceTimer::run(std::int64_t period_ns) {
  const std::uint32_t steps = steps_for_work();
  for (realtime::PeriodicClock clock{period_ns}; running_;) {
    (void)clock.wait_next();
    const std::int64_t began = realtime::monotonic_ns();
    compute(steps);
    cycles_.push({clock.due_ns() - period_ns, began, realtime::monotonic_ns(), clock.due_ns()});
  }
}

}  // namespace tactus::hrtc_service
