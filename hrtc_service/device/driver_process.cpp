#include "hrtc_service/device/driver_process.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <new>
#include <optional>
#include <utility>

#include "haptics/remote_device.hpp"
#include "realtime/process.hpp"

namespace tactus::hrtc_service {
namespace {

using haptics::DeviceError;
using haptics::Vec3d;

realtime::SharedMemory make_memory(const DriverSettings& settings) {
  realtime::SharedMemory memory = realtime::SharedMemory::create("tactus-device", sizeof(DriverLink));
  auto* const link = new (memory.data()) DriverLink;
  link->hrtc = getpid();
  link->period_ns = settings.period_ns;
  return memory;
}

std::vector<std::string> command_of(const DriverSettings& settings) {
  return {realtime::helper_program("tactus-device"), std::to_string(settings.priority), settings.library,
          settings.config};
}

/// Returns the text until the first zero byte, without characters that could change a terminal.
template <std::size_t kSize>
std::string text_of(const std::array<char, kSize>& characters) {
  std::string text(characters.data(), strnlen(characters.data(), kSize));
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, '?');
  return text;
}

std::string ms_text(std::int64_t ns) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g ms", static_cast<double>(ns) * 1e-6);
  return text;
}

/// Returns whether each number is at most 1e9, and the orientation is about a unit quaternion. False for a number that
/// is not finite.
bool is_moderate(const haptics::DeviceState& state) noexcept {
  constexpr double kMax = 1e9, kTolerance = 0.1;
  return (state.position.array().abs() <= kMax).all() && (state.velocity.array().abs() <= kMax).all() &&
         std::abs(state.orientation.norm() - 1) <= kTolerance;
}

}  // namespace

DriverProcess::DriverProcess(const DriverSettings& settings, std::function<void(const std::string&)> report)
    : memory_{make_memory(settings)},
      process_{command_of(settings), memory_.descriptor()},
      period_ns_{settings.period_ns},
      commands_{link().commands},
      states_{link().states} {
  open(settings.library);
  watcher_ = std::jthread{[this, send = std::move(report)](const std::stop_token& token) { watch(token, send); }};
}

DriverProcess::~DriverProcess() {
  request_end();
  watcher_.request_stop();
  watcher_.join();
  constexpr std::chrono::seconds kMaxEnd{2};
  if (!has_ended_) (void)process_.wait(kMaxEnd);
}

void DriverProcess::open(const std::string& library) {
  constexpr std::int64_t kMaxNs = 60'000'000'000;
  constexpr std::chrono::milliseconds kPoll{2};  // the end of the opening notifies nobody
  process_.start();
  const std::int64_t until_ns = realtime::monotonic_ns() + kMaxNs;
  while (link().is_open.load(std::memory_order_acquire) == 0) {
    if (const std::optional<int> status = process_.wait(kPoll)) {
      const std::string reason = error();
      throw DeviceError(reason.empty() ? "device driver " + library + ": its process " + realtime::text_of_end(*status)
                                       : reason);
    }
    if (realtime::stop_signal()) throw DeviceError("device driver " + library + ": interrupted while it opened");
    if (realtime::monotonic_ns() > until_ns)
      throw DeviceError("device driver " + library + ": found no open device after 60 s");
  }
  name_ = text_of(link().name);
  spec_ = link().spec;
  haptics::check(spec_, library);
}

/// Waits for the end of the process, which no one expects. Reports once that the calls of the driver are too slow, and
/// at most once a second that the process has refused commands.
void DriverProcess::watch(const std::stop_token& token, const std::function<void(const std::string&)>& report) {
  constexpr std::chrono::milliseconds kPoll{50};  // also the time after which a stop is noticed
  constexpr int kSlowPolls = 4;                   // in a row, so that a busy machine seldom causes a report
  constexpr int kRefusalPolls = 20;               // between two reports of refused commands
  int slow_polls = 0, refusal_polls = kRefusalPolls;
  std::uint32_t refused = 0;  // reported
  bool is_reported = false;
  while (!token.stop_requested()) {
    const std::optional<int> status = process_.wait(kPoll);
    if (!status) {
      const std::int64_t calls_ns = calls_ns_;
      slow_polls = calls_ns > period_ns_ ? slow_polls + 1 : 0;
      if (slow_polls == kSlowPolls && !std::exchange(is_reported, true))
        report("device " + name_ + ": a read and a write of its driver take " + ms_text(calls_ns) +
               ", expected less than a cycle, " + ms_text(period_ns_) + "; the device follows late");
      const std::uint32_t newest = refused_;
      if (++refusal_polls >= kRefusalPolls && newest != refused) {
        report(
            "device " + name_ + ": its process refused " + std::to_string(newest - refused) +
            " commands above the limits of the device and wrote zero force; its driver may write to wrong addresses");
        refused = newest;
        refusal_polls = 0;
      }
      continue;
    }
    has_ended_ = true;
    if (is_ending_) return;
    const std::string reason = error();
    report("device " + name_ + ": the process of its driver " + realtime::text_of_end(*status) +
           (reason.empty() ? "" : ": " + reason) + "; it gets no force until the HRTC starts again");
    return;
  }
}

std::string DriverProcess::error() const { return text_of(link().error); }

haptics::DeviceState DriverProcess::read(std::int64_t now_ns) noexcept {
  cycle_ns_ = now_ns;
  DriverState newest;
  if (!states_.take(newest)) return state_;
  has_failed_ = has_failed_ || newest.failed != 0;
  constexpr std::int64_t kMaxAgeNs = 1'000'000'000'000;
  constexpr auto kMaxCallsNs = static_cast<std::int64_t>(haptics::RoundTripBound::kUnknown * 1e9);
  const std::int64_t calls_ns = std::clamp<std::int64_t>(newest.calls_ns, 0, kMaxCallsNs);
  calls_ns_.store(calls_ns, std::memory_order_relaxed);
  refused_.store(newest.refused, std::memory_order_relaxed);
  state_ = newest.device;
  if (std::exchange(stops_, newest.stops) != newest.stops) state_.buttons |= haptics::kStopButton;
  // A later time would make the pose new for longer. The next state of a driver without news has this time again.
  state_.time_ns = std::clamp(state_.time_ns, now_ns - kMaxAgeNs, now_ns);
  if (!is_moderate(state_)) state_.position.fill(std::numeric_limits<double>::quiet_NaN());  // which latches a fault
  state_.orientation.normalize();
  state_.sequence = 0;
  state_.transit = 0;
  state_.round_trip = static_cast<double>(kReadAheadNs + kPollNs + calls_ns) * 1e-9;
  return state_;
}

void DriverProcess::write_wrench(const Vec3d& force, const Vec3d& torque) noexcept {
  DriverCommand command;
  Eigen::Map<Vec3d>(command.force.data()) = force;
  Eigen::Map<Vec3d>(command.torque.data()) = torque;
  command.cycle_ns = cycle_ns_;
  commands_.post(command);
}

haptics::DeviceHealth DriverProcess::health() const noexcept {
  return has_failed_ || has_ended_ ? haptics::DeviceHealth::kFailed : haptics::DeviceHealth::kReady;
}

}  // namespace tactus::hrtc_service
