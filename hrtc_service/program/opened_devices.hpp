/// Opens the devices and the tool that the options of an HRTC name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "hrtc_service/device/driver_process.hpp"
#include "hrtc_service/program/options.hpp"
#include "spm/mesh_probe.hpp"

namespace tactus::hrtc_service {

/// Loads the tool: a mesh file in metres, or "stylus". Null if `name` is empty. Throws std::runtime_error that says what
/// was found and what was expected.
[[nodiscard]] std::unique_ptr<const spm::MeshProbe> load_tool(const std::string& name);

/// The devices at this machine and the tool, for a servo.
class OpenedDevices {
 public:
  /// Opens them, and logs which they are. Throws std::runtime_error that names a device, recording or mesh that cannot
  /// be used.
  explicit OpenedDevices(const HrtcOptions& options);
  /// Closes all devices at the same time.
  ~OpenedDevices();
  OpenedDevices(const OpenedDevices&) = delete;
  OpenedDevices& operator=(const OpenedDevices&) = delete;

  /// Returns the options of a servo with these devices, which must outlive it. This servo obeys the signals of this
  /// process.
  [[nodiscard]] ServoOptions servo_options(const HrtcOptions& options) const;

 private:
  std::vector<std::unique_ptr<haptics::Device>> devices_;
  std::vector<DriverProcess*> drivers_;  // those of `devices_` with a driver
  std::unique_ptr<const spm::MeshProbe> tool_;
};

}  // namespace tactus::hrtc_service
