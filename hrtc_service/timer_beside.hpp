/// What the system itself does to a thread that keeps time: measured beside the haptic thread, so that its figures can
/// be judged by it.
#pragma once

#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <memory>
#include <thread>

#include "hrtc_service/late_cycles.hpp"
#include "hrtc_service/statistics.hpp"

namespace tactus::hrtc_service {

/// A thread that sleeps as the haptic thread does and then computes for a fixed 30 us. It shows what lateness the
/// system itself brings, and how often interrupts make little work look like an overrun.
class TimerBeside {
 public:
  /// `priority`: SCHED_FIFO; 0: do not ask.
  TimerBeside(std::int64_t period_ns, int priority);
  ~TimerBeside();
  TimerBeside(const TimerBeside&) = delete;
  TimerBeside& operator=(const TimerBeside&) = delete;

  /// Adds how late it woke since the last call, ns, and classifies late cycles. One thread.
  void drain(Samples& samples);
  /// Its cycles that were classified as overruns. The same thread.
  [[nodiscard]] std::uint64_t overruns() const noexcept { return overruns_; }
  /// Reads what the system counts for the timer's thread.
  [[nodiscard]] UsageSampler& usage() noexcept { return *usage_; }

 private:
  void compute(std::uint32_t steps) noexcept;
  [[nodiscard]] std::uint32_t steps_of_work() noexcept;
  void run(std::int64_t period_ns);

  std::atomic<bool> running_{true};
  volatile std::uint64_t number_ = 1;
  boost::lockfree::spsc_queue<CycleTimes> cycles_{8192};
  LateCycleClassifier classifier_;
  std::uint64_t overruns_ = 0;
  std::thread thread_;
  std::unique_ptr<UsageSampler> usage_;
};

}  // namespace tactus::hrtc_service
