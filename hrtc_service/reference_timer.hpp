/// Measures the delays that the system adds to a periodic thread, as a reference for the figures of the haptic thread.
#pragma once

#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <memory>
#include <thread>

#include "hrtc_service/servo/late_cycles.hpp"
#include "hrtc_service/statistics.hpp"

namespace tactus::hrtc_service {

/// A thread that sleeps like the haptic thread and computes for 30 us in each period. It shows how late the system
/// wakes a thread, and how often interrupts make a short computation an overrun.
class ReferenceTimer {
 public:
  /// `priority`: priority of SCHED_FIFO; 0: ordinary scheduling.
  ReferenceTimer(std::int64_t period_ns, int priority);
  ~ReferenceTimer();
  ReferenceTimer(const ReferenceTimer&) = delete;
  ReferenceTimer& operator=(const ReferenceTimer&) = delete;

  /// Adds the wake-up delays since the last call to `samples`, ns, and classifies late cycles. One thread.
  void drain(Samples& samples);
  /// Returns the number of overruns. Same thread as `drain`.
  [[nodiscard]] std::uint64_t overruns() const noexcept { return overruns_; }
  /// Returns the sampler of this thread's system counters.
  [[nodiscard]] UsageSampler& usage() noexcept { return *usage_; }

 private:
  void compute(std::uint32_t steps) noexcept;
  [[nodiscard]] std::uint32_t steps_for_work() noexcept;
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
