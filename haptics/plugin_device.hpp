/// Operates a device through a driver in a shared library, which is loaded at run time.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>

#include "haptics/device.hpp"

struct tactus_device;         // haptics/device_plugin.h
struct tactus_device_driver;  // haptics/device_plugin.h

namespace tactus::haptics {

class PluginDevice final : public Device {
 public:
  /// Loads `library`: a path, or a name in the system's library path. The driver then opens the device that `config`
  /// describes. Throws DeviceError with the driver's reason.
  PluginDevice(const std::string& library, const std::string& config);
  /// Commands zero force, closes the device and unloads the driver.
  ~PluginDevice() override;
  PluginDevice(const PluginDevice&) = delete;
  PluginDevice& operator=(const PluginDevice&) = delete;

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] const DeviceSpec& spec() const noexcept override { return spec_; }
  [[nodiscard]] DeviceState read(std::int64_t now_ns) noexcept override;
  void write(const Vec3d& force) noexcept override { write_wrench(force, Vec3d::Zero()); }
  void write_wrench(const Vec3d& force, const Vec3d& torque) noexcept override;
  [[nodiscard]] DeviceHealth health() const noexcept override {
    return failed_ ? DeviceHealth::kFailed : DeviceHealth::kReady;
  }
  /// Returns how long the time of a pose was after the end of `read`, ns, if the device has failed for it. Otherwise
  /// returns 0. Any thread.
  [[nodiscard]] std::int64_t ahead_ns() const noexcept { return ahead_ns_; }

 private:
  static constexpr double kSmoothing = 0.005;  // s, time constant of a velocity derived from positions
  // A later time is of another clock, for example CLOCK_REALTIME. A smaller error does not keep a pose new.
  static constexpr std::int64_t kMaxAheadNs = 500'000'000;

  std::unique_ptr<void, int (*)(void*)> library_;
  const tactus_device_driver* driver_ = nullptr;
  tactus_device* device_ = nullptr;
  std::string name_;
  DeviceSpec spec_;
  bool has_velocity_ = false;
  bool writes_torque_ = false;
  DeviceState state_;
  Vec3d timed_position_ = Vec3d::Zero();  // position when the time of the pose last changed
  std::int64_t pose_time_ns_ = std::numeric_limits<std::int64_t>::min();  // of the newest pose, from the driver
  bool has_pose_ = false;
  bool failed_ = false;
  std::atomic<std::int64_t> ahead_ns_{0};
};

}  // namespace tactus::haptics
