/// What the system itself does to a thread that keeps time: measured beside the haptic thread, so that its figures can
/// be judged by it.
#pragma once

#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <thread>

#include "hrtc_service/statistics.hpp"

namespace tactus::hrtc_service {

/// A thread that sleeps as the haptic one does and then computes for a fixed 30 us: what lateness the system itself
/// brings, and how often it makes little work look like much.
class TimerBeside {
 public:
  /// `priority`: SCHED_FIFO; 0: do not ask.
  TimerBeside(std::int64_t period_ns, int priority);
  ~TimerBeside();
  TimerBeside(const TimerBeside&) = delete;
  TimerBeside& operator=(const TimerBeside&) = delete;

  /// How late it woke since the last call, ns. One thread.
  void drain(Samples& samples);
  /// Its cycles that were late as if by their own work.
  [[nodiscard]] std::uint64_t late() const noexcept { return late_; }

 private:
  void compute(std::uint32_t steps) noexcept;
  [[nodiscard]] std::uint32_t steps_of_work() noexcept;
  void run(std::int64_t period_ns, int priority);

  std::atomic<bool> running_{true};
  std::atomic<std::uint64_t> late_{0};
  volatile std::uint64_t number_ = 1;
  boost::lockfree::spsc_queue<std::uint32_t> lateness_{8192};
  std::thread thread_;
};

}  // namespace tactus::hrtc_service
