#include "hrtc_service/device/driver_loop.hpp"

#include <algorithm>

#include "realtime/process.hpp"
#include "realtime/realtime.hpp"

namespace tactus::hrtc_service {

using haptics::Vec3d;
using realtime::monotonic_ns;

DriverLoop::DriverLoop(haptics::Device& device, DriverLink& link) noexcept
    : device_{device}, period_ns_{link.period_ns}, commands_{link.commands}, states_{link.states} {}

void DriverLoop::run(const std::atomic<bool>& stop) noexcept {
  std::int64_t cycle_ns = monotonic_ns();  // planned start of the next cycle
  while (!stop.load(std::memory_order_relaxed)) {
    realtime::sleep_until(cycle_ns - kReadAheadNs);
    send_state();
    const bool is_commanded = wait_for_command(cycle_ns);
    const std::int64_t now_ns = monotonic_ns();
    if (is_commanded)
      write_newest();
    else if (exerts_force_ && now_ns - written_ns_ >= kMaxSilenceNs)
      write(Vec3d::Zero(), Vec3d::Zero());
    cycle_ns = period_ns_ + (is_commanded ? std::clamp(command_.cycle_ns, now_ns - period_ns_, now_ns) : now_ns);
    steps_.fetch_add(1, std::memory_order_relaxed);
  }
  write(Vec3d::Zero(), Vec3d::Zero());
}

void DriverLoop::send_state() noexcept {
  DriverState state;
  const std::int64_t now_ns = monotonic_ns();
  state.device = device_.read(now_ns);
  state.failed = device_.health() == haptics::DeviceHealth::kFailed ? 1 : 0;
  states_.post(state);
}

/// Returns false if this cycle and the next one bring no command. From then on, searches only once for each cycle.
bool DriverLoop::wait_for_command(std::int64_t cycle_ns) noexcept {
  const std::int64_t until_ns = is_commanded_ ? cycle_ns + 2 * period_ns_ : 0;
  std::int64_t poll_ns = cycle_ns;
  while (!(is_commanded_ = commands_.take(command_))) {
    if (poll_ns >= until_ns) return false;
    poll_ns = std::max(poll_ns + kPollNs, monotonic_ns());
    realtime::sleep_until(poll_ns);
  }
  return true;
}

/// Writes the newest command, or zero force if it is old.
void DriverLoop::write_newest() noexcept {
  if (monotonic_ns() - command_.cycle_ns > kMaxSilenceNs)
    write(Vec3d::Zero(), Vec3d::Zero());
  else
    write(Vec3d{command_.force.data()}, Vec3d{command_.torque.data()});
}

void DriverLoop::write(const Vec3d& force, const Vec3d& torque) noexcept {
  device_.write_wrench(force, torque);
  exerts_force_ = !force.isZero(0) || !torque.isZero(0);
  written_ns_ = monotonic_ns();
}

}  // namespace tactus::hrtc_service
