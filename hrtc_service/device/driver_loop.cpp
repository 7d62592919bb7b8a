#include "hrtc_service/device/driver_loop.hpp"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>

#include "realtime/process.hpp"
#include "realtime/realtime.hpp"

namespace tactus::hrtc_service {

using haptics::Vec3d;
using realtime::monotonic_ns;

DriverLoop::DriverLoop(haptics::Device& device, DriverLink& link) noexcept
    : device_{device},
      link_{link},
      period_ns_{link.period_ns},
      commands_{link.commands},
      states_{link.states},
      seen_{link.commands_posted.load(std::memory_order_acquire)} {}

void DriverLoop::run(const std::atomic<bool>& stop) noexcept {
  DriverCommand command;
  while (!stop.load(std::memory_order_relaxed)) {
    send_state();
    const bool is_posted =
        wait_for_command((exerts_force_ ? written_ns_ : monotonic_ns()) + kMaxSilenceNs) && commands_.take(command);
    steps_.fetch_add(1, std::memory_order_relaxed);
    if (is_posted) {
      write(command);
      const std::int64_t now_ns = monotonic_ns();
      realtime::sleep_until(std::clamp(command.cycle_ns + period_ns_ - kReadAheadNs, now_ns, now_ns + period_ns_));
    } else if (exerts_force_ && monotonic_ns() - written_ns_ >= kMaxSilenceNs) {
      write({});
    }
  }
  write({});
}

void DriverLoop::send_state() noexcept {
  DriverState state;
  const std::int64_t now_ns = monotonic_ns();
  state.device = device_.read(now_ns);
  state.failed = device_.health() == haptics::DeviceHealth::kFailed ? 1 : 0;
  states_.post(state);
}

/// Returns true after a command, and false at `until_ns` or after a signal.
bool DriverLoop::wait_for_command(std::int64_t until_ns) noexcept {
  constexpr std::int64_t kNsPerS = 1'000'000'000;
  const timespec until{until_ns / kNsPerS, until_ns % kNsPerS};
  std::uint32_t posted = 0;
  while ((posted = link_.commands_posted.load(std::memory_order_acquire)) == seen_) {
    // With FUTEX_WAIT_BITSET the time is absolute.
    const long result =
        syscall(SYS_futex, &link_.commands_posted, FUTEX_WAIT_BITSET, seen_, &until, nullptr, FUTEX_BITSET_MATCH_ANY);
    if (result != 0 && errno != EAGAIN) return false;
  }
  seen_ = posted;
  return true;
}

/// Writes the force of a command, or zero if the command is old.
void DriverLoop::write(const DriverCommand& command) noexcept {
  const std::int64_t now_ns = monotonic_ns();
  const bool is_old = now_ns - command.cycle_ns > kMaxSilenceNs;
  const Vec3d force = is_old ? Vec3d::Zero() : Vec3d{command.force.data()};
  const Vec3d torque = is_old ? Vec3d::Zero() : Vec3d{command.torque.data()};
  device_.write_wrench(force, torque);
  exerts_force_ = !force.isZero(0) || !torque.isZero(0);
  written_ns_ = now_ns;
}

}  // namespace tactus::hrtc_service
