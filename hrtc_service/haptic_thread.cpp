#include "hrtc_service/haptic_thread.hpp"

#include <unistd.h>

#include <algorithm>
#include <future>
#include <memory>
#include <utility>

#include "hrtc_service/realtime.hpp"
#include "hrtc_service/ring_memory.hpp"

namespace tactus::hrtc_service {

HapticThread::HapticThread(const HapticSettings& settings, Servo& servo, DeviceLink& link, const LocalDevices& local)
    : settings_{settings},
      servo_{servo},
      traces_{kTraces},
      governor_{settings.deadline_ns},
      devices_{link, local, settings.frame} {
  touch_memory(traces_);
}

HapticThread::~HapticThread() { stop(); }

std::string HapticThread::start() {
  std::promise<std::string> granted;
  std::future<std::string> future = granted.get_future();
  pid_t thread_id = 0;
  running_ = true;
  thread_ = std::thread{[this, &granted, &thread_id] {
    pthread_setname_np(pthread_self(), "haptic");
    thread_id = gettid();
    granted.set_value(settings_.priority > 0 ? wire::enter_realtime("haptic thread", settings_.priority)
                                             : "haptic thread: no real-time priority requested");
    run();
  }};
  std::string line = future.get();
  usage_ = std::make_unique<UsageSampler>(thread_.native_handle(), thread_id);
  if (!usage_->available()) line += "; the system does not report its run-queue wait, so late cycles stay unclassified";
  return line;
}

void HapticThread::stop() {
  running_ = false;
  if (thread_.joinable()) thread_.join();
}

void HapticThread::trace(const CycleResult& result, const CycleTimes& times, std::int64_t wake_late,
                         std::uint64_t skipped) noexcept {
  CycleTrace trace;
  trace.costs = result.costs;
  trace.times = times;
  trace.wake_late = static_cast<std::uint32_t>(wake_late);
  trace.skipped = static_cast<std::uint32_t>(skipped);
  for (const ProbeOutput& probe : result.probes) {
    trace.active = static_cast<std::uint8_t>(trace.active + (probe.active ? 1 : 0));
    trace.stale = static_cast<std::uint8_t>(trace.stale + ((probe.status & session::kStalePose) != 0 ? 1 : 0));
    if ((probe.status & session::kInContact) == 0) continue;
    ++trace.in_contact;
    trace.exact = static_cast<std::uint8_t>(trace.exact + ((probe.status & session::kExact) != 0 ? 1 : 0));
  }
  trace.targets_dropped = result.targets_dropped;
  if (!traces_.push(trace)) traces_dropped_.fetch_add(1, std::memory_order_relaxed);
}

void HapticThread::run() {
  constexpr spm::Budget kAll{1u << 20};
  const std::int64_t period_ns = settings_.period_ns();
  PeriodicClock clock{period_ns};
  std::uint64_t skipped = 0;
  while (running_.load(std::memory_order_relaxed)) {
    const std::int64_t wake_late = clock.wait_next();
    const std::int64_t now_ns = monotonic_ns();
    if (const std::uint32_t requested = snapshots_requested_.load(std::memory_order_relaxed);
        std::exchange(snapshots_begun_, requested) != requested)
      servo_.begin_snapshot();
    devices_.read(now_ns, inputs_);
    devices_.write(servo_.touch(inputs_, now_ns));
    servo_.publish(now_ns, clock.due_ns());
    const CycleResult& result = servo_.refine(kAll, governor_.limit());
    trace(result, {clock.due_ns() - period_ns, now_ns, monotonic_ns(), clock.due_ns()}, wake_late,
          clock.skipped() - skipped);
    skipped = clock.skipped();
    const CycleCosts& costs = result.costs;
    if (costs.predicted_total > 0)
      governor_.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                        costs.total(), costs.predicted_total);
  }
  devices_.release();
}

}  // namespace tactus::hrtc_service
