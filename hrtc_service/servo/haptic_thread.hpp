/// Runs the servo in a thread of its own: reads the devices, computes a cycle each period, and writes the forces.
///
///   read devices -> Servo::touch -> write forces -> Servo::publish -> Servo::refine --> traces
///
/// The loop does not allocate, lock or log. Its system calls are the sleep and, after a cycle of more than three
/// periods, a reading of the CPU time (Overload).
/// docs/explanation/cycle.md follows one pose through the loop.
#pragma once

#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "haptics/device.hpp"
#include "hrtc_service/servo/governor.hpp"
#include "hrtc_service/servo/late_cycles.hpp"
#include "hrtc_service/servo/overload.hpp"
#include "hrtc_service/servo/probe_devices.hpp"
#include "hrtc_service/servo/servo.hpp"

namespace tactus::hrtc_service {

struct HapticSettings {
  double period = 0.001;               ///< of cycles, s
  std::int64_t deadline_ns = 250'000;  ///< max time of a cycle's own work
  int priority = 60;                   ///< of SCHED_FIFO; 0: ordinary scheduling
  haptics::DeviceFrame frame;          ///< of the devices at this machine
  HandLimits limits;                   ///< of the devices at this machine

  [[nodiscard]] std::int64_t period_ns() const noexcept { return std::llround(period * 1e9); }
};

class HapticThread {
 public:
  /// `servo`, `link` and the devices in `local` must outlive the thread. While the thread runs, other threads may call
  /// only `Servo::snapshot`, `Servo::snapshots_done` and `Servo::release_snapshot`.
  HapticThread(const HapticSettings& settings, Servo& servo, ServoLink& link, const LocalDevices& local = {});
  ~HapticThread();

  /// Starts the thread, and returns a log line about its priority.
  [[nodiscard]] std::string start();
  void stop();

  /// Returns the planned start of the next cycle, ns. Any thread.
  [[nodiscard]] std::int64_t next_due_ns() const noexcept { return next_due_ns_.load(std::memory_order_relaxed); }
  /// Returns the sampler of the thread's system counters. Call it only after `start`.
  [[nodiscard]] UsageSampler& usage() noexcept { return *usage_; }

 private:
  void run();
  void trace(const CycleResult& result, const CycleTimes& times, std::int64_t wake_late,
             std::uint64_t skipped) noexcept;

  HapticSettings settings_;
  Servo& servo_;
  ServoLink& link_;
  RingWriter<CycleTrace, ServoLink::kTraces> traces_;
  Governor governor_;
  Overload overload_;
  std::thread thread_;
  std::unique_ptr<UsageSampler> usage_;
  std::atomic<bool> running_{false};
  std::atomic<std::int64_t> next_due_ns_{0};

  // Haptic thread only.
  ProbeDevices devices_;
  Servo::Inputs inputs_;
  std::uint32_t snapshots_begun_ = 0;
};

}  // namespace tactus::hrtc_service
