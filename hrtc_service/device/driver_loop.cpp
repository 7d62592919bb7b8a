#include "hrtc_service/device/driver_loop.hpp"

#include "realtime/process.hpp"
#include "realtime/realtime.hpp"

namespace tactus::hrtc_service {

using haptics::Vec3d;
using realtime::monotonic_ns;

namespace {

/// Adds the time since `began_ns` to a mean. A single slow call changes neither the time of the next read nor the
/// stiffness.
void add_to_mean(std::int64_t& mean_ns, std::int64_t began_ns) noexcept {
  constexpr int kMeanOf = 64;  // calls
  mean_ns += (monotonic_ns() - began_ns - mean_ns) / kMeanOf;
}

}  // namespace

DriverLoop::DriverLoop(haptics::Device& device, DriverLink& link) noexcept
    : device_{device},
      is_ending_{link.is_ending},
      period_ns_{link.period_ns},
      timeout_ns_{timeout_ns(link.period_ns)},
      commands_{link.commands},
      states_{link.states} {}

void DriverLoop::run() noexcept {
  std::int64_t next_ns = monotonic_ns();  // planned start of the next cycle
  while (is_ending_.load(std::memory_order_relaxed) == 0) {
    realtime::sleep_until(next_ns - kReadAheadNs - std::min(read_ns_, period_ns_ / 2));
    send_state();
    if (wait_for_command(next_ns)) {
      const std::int64_t now_ns = monotonic_ns();
      cycle_ns_ = std::clamp(command_.cycle_ns, now_ns - 2 * timeout_ns_, now_ns);
      write_command();
      next_ns = planned_start() + period_ns_;
    } else {
      next_ns = monotonic_ns() + period_ns_;
      if (strength_ > 0) next_ns = std::min(next_ns, cycle_ns_ + timeout_ns_ + kReadAheadNs);
    }
    if (monotonic_ns() - cycle_ns_ >= timeout_ns_) {
      strength_ = 0;
      device_.write(Vec3d::Zero());
    }
    steps_.fetch_add(1, std::memory_order_relaxed);
  }
  device_.write(Vec3d::Zero());
}

/// Returns the planned start of the newest cycle with a command. The haptic thread wakes up late by a varying time, and
/// never early. So this is the earliest of the recent starts, moved by periods. It may move later by 1 us in each cycle.
std::int64_t DriverLoop::planned_start() noexcept {
  const std::int64_t passed_ns = cycle_ns_ - planned_ns_ + period_ns_ / 5;  // a start may be early by a fifth
  const std::int64_t expected_ns = planned_ns_ + passed_ns / period_ns_ * period_ns_ + 1'000;
  planned_ns_ = planned_ns_ == 0 ? cycle_ns_ : std::min(cycle_ns_, expected_ns);
  return planned_ns_;
}

void DriverLoop::send_state() noexcept {
  DriverState state;
  const std::int64_t began_ns = monotonic_ns();
  state.device = device_.read(began_ns);
  add_to_mean(read_ns_, began_ns);
  state.calls_ns = read_ns_ + write_ns_;
  state.failed = device_.health() == haptics::DeviceHealth::kFailed ? 1 : 0;
  const bool is_stopped = (state.device.buttons & haptics::kStopButton) != 0;
  if (is_stopped && !is_stopped_) ++stops_;
  is_stopped_ = is_stopped;
  state.stops = stops_;
  state.refused = refused_;
  states_.post(state);
}

/// Returns false if this cycle and the next one bring no command, or the timeout is over. Without commands it looks only
/// once in each cycle.
bool DriverLoop::wait_for_command(std::int64_t next_ns) noexcept {
  const std::int64_t until_ns = is_commanded_ ? std::min(next_ns + 2 * period_ns_, cycle_ns_ + timeout_ns_) : 0;
  std::int64_t poll_ns = next_ns;
  while (!(is_commanded_ = commands_.take(command_))) {
    if (poll_ns >= until_ns) return false;
    poll_ns = std::max(poll_ns + kPollNs, monotonic_ns());
    realtime::sleep_until(poll_ns);
  }
  return true;
}

/// Returns whether the device has these limits. If not, the driver has probably written to the memory of the commands,
/// because the HRTC obeys the limits. False for a number that is not finite.
bool DriverLoop::is_allowed(const Vec3d& force, const Vec3d& torque) const noexcept {
  constexpr double kRounding = 1 + 1e-6;
  const haptics::DeviceSpec& spec = device_.spec();
  return force.norm() <= kRounding * spec.max_force && torque.norm() <= kRounding * spec.max_torque;
}

/// Writes the force of the newest command. One that is too old has no effect, because zero force follows at once.
/// Writes zero force instead of one that the device does not allow.
void DriverLoop::write_command() noexcept {
  constexpr double kRecovery = 0.1;  // s, as after old poses (haptics/force.hpp)
  if (monotonic_ns() - cycle_ns_ >= timeout_ns_) return;
  const Vec3d force{command_.force.data()}, torque{command_.torque.data()};
  if (!is_allowed(force, torque)) {
    ++refused_;
    strength_ = 0;
    device_.write(Vec3d::Zero());
    return;
  }
  strength_ = std::min(1.0, strength_ + static_cast<double>(period_ns_) * 1e-9 / kRecovery);
  const std::int64_t began_ns = monotonic_ns();
  device_.write_wrench(strength_ * force, strength_ * torque);
  add_to_mean(write_ns_, began_ns);
}

}  // namespace tactus::hrtc_service
