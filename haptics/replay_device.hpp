/// Plays recorded positions as a device and ignores every force.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "haptics/device.hpp"

namespace tactus::haptics {

/// The replay begins with the first `read`. Poses are interpolated linearly. After the last pose the device rests.
class ReplayDevice final : public Device {
 public:
  /// Loads a text file of lines `time_s,x,y,z` with ascending times and positions in metres, device frame. Empty lines,
  /// lines that begin with `#` and a first line of names are skipped. Throws DeviceError.
  explicit ReplayDevice(const std::string& path, const DeviceSpec& spec = {});

  [[nodiscard]] const DeviceSpec& spec() const noexcept override { return spec_; }
  [[nodiscard]] DeviceState read(std::int64_t now_ns) noexcept override;
  void write(const Vec3d&) noexcept override {}
  [[nodiscard]] DeviceHealth health() const noexcept override {
    return ended_ ? DeviceHealth::kEnded : DeviceHealth::kReady;
  }
  [[nodiscard]] std::size_t size() const noexcept { return poses_.size(); }

 private:
  struct TimedPosition {
    double time;
    Vec3d position;
  };
  DeviceSpec spec_;
  std::vector<TimedPosition> poses_;
  std::size_t next_ = 0;  // index of the first pose after the current time
  std::int64_t start_ns_ = 0;
  bool started_ = false;
  bool ended_ = false;
};

}  // namespace tactus::haptics
