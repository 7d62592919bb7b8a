/// Runs the servo in a thread of its own: reads the devices, computes a cycle each period, and writes the forces.
///
///   read devices -> Servo::touch -> write forces -> Servo::publish -> Servo::refine --> traces
///
/// The loop does not allocate, lock or log, and its only system calls are the sleep and those of device drivers.
/// docs/explanation/cycle.md follows one pose through the loop.
#pragma once

#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "haptics/device.hpp"
#include "hrtc_service/governor.hpp"
#include "hrtc_service/late_cycles.hpp"
#include "hrtc_service/probe_devices.hpp"
#include "hrtc_service/servo.hpp"

namespace tactus::hrtc_service {

/// Measurements of one cycle.
struct CycleTrace {
  CycleCosts costs;
  CycleTimes times;
  std::uint32_t wake_late = 0;  ///< wake-up time minus due time, ns
  std::uint32_t skipped = 0;    ///< periods skipped before this cycle
  std::uint8_t active = 0;      ///< active probes
  std::uint8_t in_contact = 0;  ///< probes in contact
  std::uint8_t exact = 0;       ///< probes in exact contact
  std::uint8_t stale = 0;       ///< probes with a stale pose
  bool targets_dropped = false;
};

struct HapticSettings {
  double period = 0.001;               ///< of cycles, s
  std::int64_t deadline_ns = 250'000;  ///< max time of a cycle's own work
  int priority = 60;                   ///< of SCHED_FIFO; 0: ordinary scheduling
  haptics::DeviceFrame frame;          ///< of the devices at this machine

  [[nodiscard]] std::int64_t period_ns() const noexcept { return std::llround(period * 1e9); }
};

class HapticThread {
 public:
  using TraceRing = boost::lockfree::spsc_queue<CycleTrace>;
  static constexpr std::size_t kTraces = 8192;

  /// `servo`, `link` and the devices in `local` must outlive the thread. While the thread runs, other threads may call
  /// only `Servo::snapshot` and `Servo::snapshots_done`.
  HapticThread(const HapticSettings& settings, Servo& servo, DeviceLink& link, const LocalDevices& local = {});
  ~HapticThread();

  /// Starts the thread, and returns a log line about its priority.
  [[nodiscard]] std::string start();
  void stop();

  /// Requests a copy of the active meshes. Returns the number of the copy (Servo::snapshots_done). One thread.
  std::uint32_t request_snapshot() noexcept { return snapshots_requested_.fetch_add(1, std::memory_order_relaxed) + 1; }
  [[nodiscard]] TraceRing& traces() noexcept { return traces_; }
  /// Returns the sampler of the thread's system counters. Call it only after `start`.
  [[nodiscard]] UsageSampler& usage() noexcept { return *usage_; }
  [[nodiscard]] std::uint64_t traces_dropped() const noexcept {
    return traces_dropped_.load(std::memory_order_relaxed);
  }

 private:
  void run();
  void trace(const CycleResult& result, const CycleTimes& times, std::int64_t wake_late,
             std::uint64_t skipped) noexcept;

  HapticSettings settings_;
  Servo& servo_;
  TraceRing traces_;
  Governor governor_;
  std::thread thread_;
  std::unique_ptr<UsageSampler> usage_;
  std::atomic<bool> running_{false};
  std::atomic<std::uint64_t> traces_dropped_{0};
  std::atomic<std::uint32_t> snapshots_requested_{0};

  // Haptic thread only.
  ProbeDevices devices_;
  Servo::Inputs inputs_;
  std::uint32_t snapshots_begun_ = 0;
};

}  // namespace tactus::hrtc_service
