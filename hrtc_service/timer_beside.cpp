#include "hrtc_service/timer_beside.hpp"

#include <pthread.h>

#include <algorithm>

#include "hrtc_service/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kWorkNs = 30'000;

}  // namespace

TimerBeside::TimerBeside(std::int64_t period_ns, int priority)
    : thread_{[this, period_ns, priority] { run(period_ns, priority); }} {}

TimerBeside::~TimerBeside() {
  running_ = false;
  thread_.join();
}

void TimerBeside::drain(Samples& samples) {
  std::uint32_t late;
  while (lateness_.pop(late)) samples.add(late);
}

void TimerBeside::compute(std::uint32_t steps) noexcept {
  for (std::uint32_t i = 0; i < steps; ++i) number_ = number_ * 6364136223846793005u + 1442695040888963407u;
}

std::uint32_t TimerBeside::steps_of_work() noexcept {
  constexpr std::uint32_t kTried = 10000;
  std::int64_t best = kWorkNs;
  for (int round = 0; round < 8; ++round) {
    const std::int64_t began = monotonic_ns();
    compute(kTried);
    best = std::min(best, monotonic_ns() - began);
  }
  return static_cast<std::uint32_t>(kTried * kWorkNs / std::max<std::int64_t>(best, 1));
}

void TimerBeside::run(std::int64_t period_ns, int priority) {
  pthread_setname_np(pthread_self(), "timer");
  if (priority > 0) (void)wire::enter_realtime("timer", priority);
  const std::uint32_t steps = steps_of_work();
  for (PeriodicClock clock{period_ns}; running_;) {
    lateness_.push(static_cast<std::uint32_t>(clock.wait_next()));
    const std::int64_t began = monotonic_ns(), cpu = thread_cpu_ns();
    compute(steps);
    const std::int64_t end = monotonic_ns();
    if (end > clock.due_ns() && own_work(thread_cpu_ns() - cpu, end - began, period_ns)) ++late_;
  }
}

}  // namespace tactus::hrtc_service
