/// A device whose driver runs in a process of its own, tactus-device.
///
/// A driver of a vendor is foreign code. If it crashes or hangs, the other forces go on, and its libraries do not share
/// the memory of the haptic thread. A force stays for at most 10 ms if the haptic thread computes no other
/// (driver_loop.hpp). If the driver's process ends, or reports a failure, the device has failed: Tactus commands no force
/// to it until the HRTC starts again.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

#include "haptics/device.hpp"
#include "hrtc_service/device/driver_link.hpp"
#include "realtime/child_process.hpp"
#include "realtime/shared_memory.hpp"

namespace tactus::hrtc_service {

struct DriverSettings {
  std::string library;  ///< a path, or a name in the system's library path
  std::string config;   ///< for the driver
  std::int64_t period_ns = 1'000'000;
  int priority = 60;  ///< of SCHED_FIFO; 0: ordinary scheduling
};

class DriverProcess final : public haptics::Device {
 public:
  /// Starts the process, and waits until the driver has opened the device, at most 60 s or until a signal requests the
  /// end of this program. `report` receives a line if the process ends before this object, one if a read and
  /// a write of the driver take longer than a cycle, and at most one a second if the process refuses commands. Another
  /// thread calls it.
  /// Throws DeviceError with the driver's reason, or std::system_error.
  DriverProcess(const DriverSettings& settings, std::function<void(const std::string&)> report);
  /// Waits until the driver has written zero force and closed the device, at most 2 s. Then kills its process.
  ~DriverProcess() override;
  DriverProcess(const DriverProcess&) = delete;
  DriverProcess& operator=(const DriverProcess&) = delete;

  /// Lets the driver write zero force and close the device, and does not wait for it.
  void request_end() noexcept {
    is_ending_ = true;
    link().is_ending = 1;
  }

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] const haptics::DeviceSpec& spec() const noexcept override { return spec_; }
  /// The newest state; its position is not finite if a number of it is not plausible. Realtime.
  [[nodiscard]] haptics::DeviceState read(std::int64_t now_ns) noexcept override;
  /// Realtime.
  void write_wrench(const haptics::Vec3d& force, const haptics::Vec3d& torque) noexcept override;
  void write(const haptics::Vec3d& force) noexcept override { write_wrench(force, haptics::Vec3d::Zero()); }
  [[nodiscard]] haptics::DeviceHealth health() const noexcept override;

 private:
  [[nodiscard]] DriverLink& link() const noexcept { return *reinterpret_cast<DriverLink*>(memory_.data()); }
  void open(const std::string& library);
  void watch(const std::stop_token& token, const std::function<void(const std::string&)>& report);
  [[nodiscard]] std::string error() const;

  realtime::SharedMemory memory_;
  realtime::ChildProcess process_;
  std::string name_;
  haptics::DeviceSpec spec_;
  const std::int64_t period_ns_;
  std::atomic<bool> is_ending_{false}, has_ended_{false};
  std::atomic<std::int64_t> calls_ns_{0};  // DriverState::calls_ns of the newest state
  std::atomic<std::uint32_t> refused_{0};  // DriverState::refused of the newest state
  std::jthread watcher_;

  // Haptic thread only.
  MailboxWriter<DriverCommand> commands_;
  MailboxReader<DriverState> states_;
  haptics::DeviceState state_;  // newest
  std::int64_t cycle_ns_ = 0;
  std::uint32_t stops_ = 0;  // DriverState::stops of the newest state
  bool has_failed_ = false;
};

}  // namespace tactus::hrtc_service
