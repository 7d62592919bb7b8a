#include "hrtc_service/program/opened_devices.hpp"

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include "event_log/event_log.hpp"
#include "haptics/replay_device.hpp"
#include "realtime/process.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"

namespace tactus::hrtc_service {
namespace {

/// Opens the device of a user by its driver.
std::unique_ptr<DriverProcess> open_driver(const LocalUser& local, const HapticSettings& haptic) {
  const std::size_t comma = local.device.find(',');
  DriverSettings settings;
  settings.library = local.device.substr(0, comma);
  settings.config = comma == std::string::npos ? "" : local.device.substr(comma + 1);
  settings.period_ns = haptic.period_ns();
  settings.priority = haptic.priority;
  const auto log_error = [user = local.user](const std::string& text) {
    event_log::write(session::Severity::kError, "user " + user + ": " + text);
  };
  auto device = std::make_unique<DriverProcess>(settings, log_error);
  event_log::write(session::Severity::kInfo, "device " + device->name());
  return device;
}

}  // namespace

std::unique_ptr<const spm::MeshProbe> load_tool(const std::string& name) {
  if (name.empty()) return nullptr;
  constexpr double kMaxRadius = 1;  // m; a larger mesh probably has another unit
  const spm::offline::TriangleMesh mesh = name == "stylus" ? spm::offline::stylus() : spm::offline::import_mesh(name);
  std::unique_ptr<const spm::MeshProbe> tool;
  try {
    tool = std::make_unique<const spm::MeshProbe>(mesh.positions, mesh.faces);
  } catch (const std::exception& error) {
    throw std::runtime_error("--tool " + name + ": " + error.what());
  }
  if (tool->radius() > kMaxRadius)
    throw std::runtime_error("--tool " + name + ": found a vertex at " + std::to_string(tool->radius()) +
                             " from the origin, expected metres, at most " + std::to_string(kMaxRadius));
  return tool;
}

OpenedDevices::OpenedDevices(const HrtcOptions& options) {
  for (const LocalUser& local : options.local_users) {
    if (local.is_replayed)
      devices_.push_back(std::make_unique<haptics::ReplayDevice>(local.device));
    else
      drivers_.push_back(static_cast<DriverProcess*>(devices_.emplace_back(open_driver(local, options.haptic)).get()));
  }
  tool_ = load_tool(options.tool);
  if (tool_ == nullptr) return;
  char text[128];
  std::snprintf(text, sizeof text, ": %zu triangles, %.1f mm from the tip at most",
                static_cast<std::size_t>(tool_->triangles()), tool_->radius() * 1e3);
  event_log::write(session::Severity::kInfo, "tool " + options.tool + text);
}

OpenedDevices::~OpenedDevices() {
  for (DriverProcess* driver : drivers_) driver->request_end();
}

ServoOptions OpenedDevices::servo_options(const HrtcOptions& options) const {
  ServoOptions servo;
  servo.participant = options.address.participant;
  servo.pool = options.pool;
  servo.directory_bytes = options.directory_bytes;
  servo.servo = options.servo;
  servo.servo.cycle.tool = tool_.get();
  servo.haptic = options.haptic;
  for (std::size_t i = 0; i < std::min<std::size_t>(devices_.size(), kMaxProbes); ++i)
    servo.local[i] = devices_[i].get();
  servo.max_users = options.max_users;
  servo.flight = options.flight;
  servo.servo.emergency_stop_signals = &realtime::emergency_stop_signals();
  servo.save_requests = &realtime::save_signals();
  return servo;
}

}  // namespace tactus::hrtc_service
