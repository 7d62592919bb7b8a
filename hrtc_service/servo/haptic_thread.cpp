#include "hrtc_service/servo/haptic_thread.hpp"

#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <future>
#include <memory>

#include "realtime/periodic_clock.hpp"

namespace tactus::hrtc_service {
namespace {

std::int64_t thread_cpu_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

}  // namespace

HapticThread::HapticThread(const HapticSettings& settings, Servo& servo, ServoLink& link, const LocalDevices& local)
    : settings_{settings},
      servo_{servo},
      link_{link},
      traces_{link.traces},
      governor_{settings.deadline_ns},
      overload_{settings.period_ns()},
      devices_{link.devices, local, settings.frame, settings.limits} {}

HapticThread::~HapticThread() { stop(); }

std::string HapticThread::start() {
  std::promise<std::string> granted;
  std::future<std::string> future = granted.get_future();
  pid_t thread_id = 0;
  running_ = true;
  thread_ = std::thread{[this, &granted, &thread_id] {
    pthread_setname_np(pthread_self(), "haptic");
    thread_id = gettid();
    granted.set_value(settings_.priority > 0 ? realtime::enter_realtime("haptic thread", settings_.priority)
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
  if (!traces_.push(trace)) link_.count_dropped_trace();
}

void HapticThread::run() {
  constexpr spm::Budget kAll{1u << 20};
  const std::int64_t period_ns = settings_.period_ns();
  realtime::PeriodicClock clock{period_ns};
  std::uint64_t skipped = 0;
  while (running_.load(std::memory_order_relaxed)) {
    const std::int64_t wake_late = clock.wait_next();
    const std::int64_t now_ns = realtime::monotonic_ns();
    next_due_ns_.store(clock.due_ns(), std::memory_order_relaxed);
    if (const std::uint32_t requested = link_.snapshot_requests();
        requested != snapshots_begun_ && servo_.begin_snapshot())
      snapshots_begun_ = requested;
    devices_.read(now_ns, inputs_);
    devices_.write(servo_.touch(inputs_, now_ns));
    servo_.publish(now_ns, clock.due_ns());
    const CycleResult& result = servo_.refine(kAll, governor_.limit());
    trace(result, {clock.due_ns() - period_ns, now_ns, realtime::monotonic_ns(), clock.due_ns()}, wake_late,
          clock.skipped() - skipped);
    skipped = clock.skipped();
    const CycleCosts& costs = result.costs;
    if (overload_.observe(realtime::monotonic_ns() - now_ns, thread_cpu_ns))
      servo_.cycle().stop(haptics::Fault::kOverload);
    if (costs.predicted_total > 0)
      governor_.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                        costs.total(), costs.predicted_total);
  }
  devices_.release();
}

}  // namespace tactus::hrtc_service
