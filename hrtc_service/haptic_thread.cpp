#include "hrtc_service/haptic_thread.hpp"

#include <unistd.h>

#include <algorithm>
#include <future>
#include <memory>

#include "hrtc_service/realtime.hpp"
#include "hrtc_service/ring_memory.hpp"

namespace tactus::hrtc_service {

HapticThread::HapticThread(const HapticSettings& settings, Servo& servo)
    : settings_{settings}, servo_{servo}, traces_{kTraces}, governor_{settings.deadline_ns} {
  touch_memory(traces_);
  frames_.fill(settings.frame);
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

void HapticThread::obey(const HapticCommands& commands) noexcept {
  if (commands.snapshots != current_.snapshots) servo_.begin_snapshot();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (current_.devices[i] != nullptr && commands.devices[i] != current_.devices[i])
      current_.devices[i]->write_wrench(Vec3d::Zero(), Vec3d::Zero());
  current_ = commands;
  obeyed_.store(commands.number, std::memory_order_release);
}

void HapticThread::read_devices(std::int64_t now_ns) noexcept {
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    ProbeInput& input = inputs_[i];
    input.active = current_.devices[i] != nullptr;
    if (!input.active) continue;
    input.device = current_.devices[i]->read(now_ns);
    input.failed = current_.devices[i]->health() == haptics::DeviceHealth::kFailed;
    input.pose_age = static_cast<double>(now_ns - input.device.time_ns) * 1e-9;
    if (current_.framed[i])
      input.device = frames_[i].to_world(input.device, (input.device.buttons & haptics::kClutchButton) != 0);
  }
}

void HapticThread::write_forces() noexcept {
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (current_.devices[i] == nullptr) continue;
    const Vec3d force = vec(servo_.outputs()[i].force), torque = vec(servo_.outputs()[i].torque);
    if (current_.framed[i])
      current_.devices[i]->write_wrench(frames_[i].force_to_device(force), frames_[i].torque_to_device(torque));
    else
      current_.devices[i]->write_wrench(force, torque);
  }
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
    if (HapticCommands commands; commands_.take(commands)) obey(commands);
    read_devices(now_ns);
    servo_.touch(inputs_, now_ns);
    write_forces();
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
  for (haptics::Device* device : current_.devices)
    if (device != nullptr) device->write(Vec3d::Zero());
}

}  // namespace tactus::hrtc_service
