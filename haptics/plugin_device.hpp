/// Operates a device through a driver in a shared library, which is loaded at run time.
#pragma once

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

 private:
  static constexpr double kSmoothing = 0.005;  // s, time constant of a velocity derived from positions

  std::unique_ptr<void, int (*)(void*)> library_;
  const tactus_device_driver* driver_ = nullptr;
  tactus_device* device_ = nullptr;
  std::string name_;
  DeviceSpec spec_;
  bool has_velocity_ = false;
  bool writes_torque_ = false;
  DeviceState state_;
  bool has_pose_ = false;
  bool failed_ = false;
};

}  // namespace tactus::haptics
