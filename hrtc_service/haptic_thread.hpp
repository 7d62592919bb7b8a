/// The thread that drives the servo: period, devices, deadline.
///
///   commands --> read devices -> Servo::touch -> write forces -> Servo::publish -> Servo::refine --> traces
///
/// Its loop allocates, locks and logs nothing, and its only system call is the sleep. docs/explanation/cycle.md follows
/// one pose through it.
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

/// Commands for the probe slots. The service owns the devices and destroys one only after the thread has obeyed
/// commands without it.
struct HapticCommands {
  std::uint64_t number = 0;                            ///< increases with each command
  std::array<haptics::Device*, kMaxProbes> devices{};  ///< null: no probe
  std::array<bool, kMaxProbes> framed{};               ///< the device has a frame of its own
  std::uint32_t snapshots = 0;                         ///< increases with each request to copy the active mesh
};

/// Age and number of the pose of a report, as messages carry them.
[[nodiscard]] inline std::uint32_t age_us(const ProbeOutput& probe) noexcept {
  return static_cast<std::uint32_t>(std::clamp(probe.pose_age * 1e6f, 0.0f, 4e9f));
}

/// The figures of one cycle; ns.
struct CycleTrace {
  CycleCosts costs;
  CycleTimes times;
  std::uint32_t wake_late = 0;  ///< after its due time
  std::uint32_t skipped = 0;    ///< whole ticks missed before it
  std::uint8_t active = 0;      ///< probes
  std::uint8_t in_contact = 0;
  std::uint8_t exact = 0;  ///< of those in contact
  std::uint8_t stale = 0;  ///< probes whose pose was too old
  bool targets_dropped = false;
};

struct HapticSettings {
  double period = 0.001;               ///< s; the cycle's
  std::int64_t deadline_ns = 250'000;  ///< for the cycle's own work
  int priority = 60;                   ///< SCHED_FIFO; 0: ordinary scheduling
  haptics::DeviceFrame frame;          ///< of devices that have one of their own

  [[nodiscard]] std::int64_t period_ns() const noexcept { return std::llround(period * 1e9); }
};

class HapticThread {
 public:
  using TraceRing = boost::lockfree::spsc_queue<CycleTrace>;

  /// `servo` must outlive it; only this thread drives it.
  HapticThread(const HapticSettings& settings, Servo& servo);
  ~HapticThread();

  /// Starts; returns a log line about the granted priority and memory locking.
  [[nodiscard]] std::string start();
  void stop();

  [[nodiscard]] haptics::Mailbox<HapticCommands>& commands() noexcept { return commands_; }
  /// Whether the thread obeys commands of this number or later ones. It no longer uses a device that they do not name.
  [[nodiscard]] bool has_obeyed(std::uint64_t number) const noexcept {
    return obeyed_.load(std::memory_order_acquire) >= number;
  }
  [[nodiscard]] TraceRing& traces() noexcept { return traces_; }
  /// Reads the counters of the system for the thread; after `start`.
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

  // The thread's own.
  HapticCommands current_;
  std::array<haptics::DeviceFrame, kMaxProbes> frames_;
  Servo::Inputs inputs_;
};

/// The sender of commands to a haptic thread: each change sends all commands again. One thread.
class HapticOrders {
 public:
  explicit HapticOrders(HapticThread& to) : to_{to} {}

  template <class Change>
  void post(Change&& change) {
    change(commands_);
    ++commands_.number;
    to_.commands().post(commands_);
  }
  /// Whether the thread obeys the commands of this number.
  [[nodiscard]] bool obeyed(std::uint64_t number) const noexcept { return to_.has_obeyed(number); }
  [[nodiscard]] const HapticCommands& now() const noexcept { return commands_; }

 private:
  HapticThread& to_;
  HapticCommands commands_;
};

}  // namespace tactus::hrtc_service
