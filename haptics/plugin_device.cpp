#include "haptics/plugin_device.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <utility>

#include "haptics/device_plugin.h"

namespace tactus::haptics {
namespace {

using Entry = const tactus_device_driver* (*)();

std::unique_ptr<void, int (*)(void*)> load(const std::string& library) {
  void* const handle = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr) throw DeviceError(std::string{"device driver "} + dlerror());
  return {handle, &dlclose};
}

const tactus_device_driver& driver_in(void* handle, const std::string& library) {
  const auto entry = reinterpret_cast<Entry>(dlsym(handle, "tactus_device_entry"));
  if (entry == nullptr) throw DeviceError("device driver " + library + ": found no function tactus_device_entry");
  const tactus_device_driver* const driver = entry();
  if (driver == nullptr) throw DeviceError("device driver " + library + ": tactus_device_entry returned NULL");
  if (driver->abi < 1 || driver->abi > TACTUS_DEVICE_ABI)
    throw DeviceError("device driver " + library + ": found ABI " + std::to_string(driver->abi) + ", expected 1 to " +
                      std::to_string(TACTUS_DEVICE_ABI));
  const std::pair<const char*, bool> functions[] = {{"open", driver->open != nullptr},
                                                    {"close", driver->close != nullptr},
                                                    {"spec", driver->spec != nullptr},
                                                    {"read", driver->read != nullptr},
                                                    {"write", driver->write != nullptr}};
  for (const auto& [name, is_found] : functions)
    if (!is_found) throw DeviceError("device driver " + library + ": found no function " + name);
  return *driver;
}

std::int64_t monotonic_ns() noexcept {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();  // CLOCK_MONOTONIC
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

}  // namespace

PluginDevice::PluginDevice(const std::string& library, const std::string& config)
    : library_{load(library)}, driver_{&driver_in(library_.get(), library)} {
  name_ = driver_->name == nullptr ? library : driver_->name;
  std::array<char, 256> error{};
  device_ = driver_->open(config.c_str(), error.data(), error.size());
  error.back() = '\0';
  if (device_ == nullptr) throw DeviceError("device " + name_ + ", config '" + config + "': " + error.data());
  tactus_device_spec reported{spec_.max_force,
                              spec_.max_stiffness,
                              spec_.damping,
                              spec_.workspace_radius,
                              0,
                              0,
                              spec_.max_rotational_stiffness};
  driver_->spec(device_, &reported);
  has_velocity_ = (reported.flags & TACTUS_DEVICE_HAS_VELOCITY) != 0;
  writes_torque_ = driver_->abi >= 2 && driver_->write_wrench != nullptr;
  if (!writes_torque_) reported.max_torque = 0;
  try {
    spec_ = {reported.max_force,        reported.max_stiffness, reported.damping,
             reported.workspace_radius, reported.max_torque,    reported.max_rotational_stiffness};
    check(spec_, library);
  } catch (const DeviceError&) {
    driver_->close(device_);
    throw;
  }
}

PluginDevice::~PluginDevice() {
  write(Vec3d::Zero());
  driver_->close(device_);
}

DeviceState PluginDevice::read(std::int64_t now_ns) noexcept {
  if (failed_) return state_;
  tactus_device_pose pose{};
  pose.orientation[3] = 1;
  pose.time_ns = now_ns;
  const int result = driver_->read(device_, now_ns, &pose);
  if (result == TACTUS_DEVICE_NO_NEWS) return state_;
  if (result != TACTUS_DEVICE_POSE) {
    failed_ = true;
    return state_;
  }
  if (const std::int64_t end_ns = std::max(now_ns, monotonic_ns()); pose.time_ns > end_ns + kMaxAheadNs) {
    ahead_ns_ = pose.time_ns - end_ns;
    failed_ = true;
    return state_;
  }
  state_.buttons = pose.buttons;
  state_.position = {pose.position[0], pose.position[1], pose.position[2]};
  state_.orientation = {pose.orientation[3], pose.orientation[0], pose.orientation[1], pose.orientation[2]};
  if (has_velocity_) state_.velocity = {pose.velocity[0], pose.velocity[1], pose.velocity[2]};
  if (std::exchange(pose_time_ns_, pose.time_ns) == pose.time_ns) return state_;  // the pose becomes older
  // A later time would make the pose new for longer.
  const std::int64_t time_ns = std::clamp<std::int64_t>(pose.time_ns, 0, now_ns);
  const double passed = static_cast<double>(time_ns - state_.time_ns) * 1e-9;
  if (!has_velocity_ && has_pose_ && passed > 0)
    state_.velocity +=
        ((state_.position - timed_position_) / passed - state_.velocity) * (1 - std::exp(-passed / kSmoothing));
  has_pose_ = state_.position.allFinite() && state_.velocity.allFinite();
  if (!has_pose_ && !has_velocity_) state_.velocity.setZero();  // the filter starts anew with the next position
  timed_position_ = state_.position;
  state_.time_ns = time_ns;
  return state_;
}

void PluginDevice::write_wrench(const Vec3d& force, const Vec3d& torque) noexcept {
  if (failed_ && !(force.isZero(0) && torque.isZero(0))) return;  // a failed driver gets only zero forces
  const double value[3] = {force.x(), force.y(), force.z()}, turning[3] = {torque.x(), torque.y(), torque.z()};
  const int result = writes_torque_ ? driver_->write_wrench(device_, value, turning) : driver_->write(device_, value);
  failed_ = result != 0 || failed_;
}

}  // namespace tactus::haptics
