/// Runs the servo in a thread of its own: reads the devices, computes a cycle each period, and writes the forces.
///
///   commands --> read devices -> Servo::touch -> write forces -> Servo::publish -> Servo::refine --> traces
///
/// The loop does not allocate, lock or log, and its only system calls are the sleep and those of device drivers.
/// docs/explanation/cycle.md follows one pose through the loop.
#pragma once

#include <algorithm>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "haptics/device.hpp"
#include "haptics/mailbox.hpp"
#include "hrtc_service/governor.hpp"
#include "hrtc_service/late_cycles.hpp"
#include "hrtc_service/servo.hpp"

namespace tactus::hrtc_service {

/// Commands for the haptic thread. The service owns the devices. It destroys a device only after the thread has obeyed
/// commands that do not name it.
struct HapticCommands {
  std::uint64_t number = 0;                            ///< increases with each command
  std::array<haptics::Device*, kMaxProbes> devices{};  ///< by probe; null: no probe
  std::array<bool, kMaxProbes> framed{};               ///< poses are in the device frame of HapticSettings
  std::uint32_t snapshots = 0;                         ///< increases with each request to copy the active meshes
};

/// Returns the age of the probe's pose, us.
[[nodiscard]] inline std::uint32_t age_us(const ProbeOutput& probe) noexcept {
  return static_cast<std::uint32_t>(std::clamp(probe.pose_age * 1e6f, 0.0f, 4e9f));
}

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

  /// `servo` must outlive the thread. While the thread runs, other threads may call only `Servo::snapshot` and
  /// `Servo::snapshots_done`.
  HapticThread(const HapticSettings& settings, Servo& servo);
  ~HapticThread();

  /// Starts the thread, and returns a log line about its priority.
  [[nodiscard]] std::string start();
  void stop();

  [[nodiscard]] haptics::Mailbox<HapticCommands>& commands() noexcept { return commands_; }
  /// Returns whether the thread has obeyed the commands with this number or later ones. If so, it uses no other devices
  /// than those that these commands name.
  [[nodiscard]] bool has_obeyed(std::uint64_t number) const noexcept {
    return obeyed_.load(std::memory_order_acquire) >= number;
  }
  [[nodiscard]] TraceRing& traces() noexcept { return traces_; }
  /// Returns the sampler of the thread's system counters. Call it only after `start`.
  [[nodiscard]] UsageSampler& usage() noexcept { return *usage_; }
  [[nodiscard]] std::uint64_t traces_dropped() const noexcept {
    return traces_dropped_.load(std::memory_order_relaxed);
  }

 private:
  void run();
  void obey(const HapticCommands& commands) noexcept;
  void read_devices(std::int64_t now_ns) noexcept;
  void write_forces() noexcept;
  void trace(const CycleResult& result, const CycleTimes& times, std::int64_t wake_late,
             std::uint64_t skipped) noexcept;

  HapticSettings settings_;
  Servo& servo_;
  haptics::Mailbox<HapticCommands> commands_;
  TraceRing traces_;
  Governor governor_;
  std::thread thread_;
  std::unique_ptr<UsageSampler> usage_;
  std::atomic<bool> running_{false};
  std::atomic<std::uint64_t> traces_dropped_{0};
  std::atomic<std::uint64_t> obeyed_{0};  // number of the newest commands

  // Haptic thread only.
  HapticCommands current_;
  std::array<haptics::DeviceFrame, kMaxProbes> frames_;
  Servo::Inputs inputs_;
};

/// Posts commands to a haptic thread. One thread.
class HapticCommandPoster {
 public:
  explicit HapticCommandPoster(HapticThread& to) : to_{to} {}

  /// Applies `change` to the current commands, and posts the result.
  template <class Change>
  void post(Change&& change) {
    change(commands_);
    ++commands_.number;
    to_.commands().post(commands_);
  }
  /// Returns whether the thread has obeyed the commands with this number or later ones.
  [[nodiscard]] bool obeyed(std::uint64_t number) const noexcept { return to_.has_obeyed(number); }
  [[nodiscard]] const HapticCommands& now() const noexcept { return commands_; }

 private:
  HapticThread& to_;
  HapticCommands commands_;
};

}  // namespace tactus::hrtc_service
