#include "bench/cycle_log.hpp"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <regex>
#include <variant>

#include "realtime/process.hpp"
#include "session/messages.hpp"

namespace tactus::bench {
namespace {

constexpr double kTolerance = 1e-9;     // N, N m
constexpr double kAgeTolerance = 1e-4;  // s, of the age at which a force has to be zero
constexpr std::size_t kMaxTexts = 10;
constexpr std::int64_t kRequestNs = 2'000'000'000;

/// Not std::hypot, which returns 0 for (0, 0, NaN) in libstdc++ 12.
double norm(const std::array<double, 3>& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

}  // namespace

void ForceChecker::report(std::uint64_t cycle, const std::string& text) {
  ++violations_;
  if (texts_.size() < kMaxTexts) texts_.push_back("cycle " + std::to_string(cycle) + ": " + text);
}

double ForceChecker::check(const trace::FlightProbe& probe, const char* what, const std::array<double, 3>& now,
                           const std::array<double, 3>& before, double max, double slew) {
  const std::string name = std::string{"the "} + what + " of probe " + std::to_string(probe.probe);
  const double size = norm(now), step = norm({now[0] - before[0], now[1] - before[1], now[2] - before[2]});
  if (!std::isfinite(size)) report(probe.cycle, name + " is not finite");
  if (size > max + kTolerance) report(probe.cycle, name + " is above its limit");
  const bool is_off = (probe.status & session::kFault) != 0;
  const bool is_old = probe.pose_age > start_.zero_force_age + kAgeTolerance;
  if ((is_off || is_old) && size > 0)
    report(probe.cycle, name + (is_off ? " acts in spite of a fault" : " acts on a pose that is too old"));
  // For a fixed object, only a fault, or a pose that is too old, switches a force off at once.
  const bool may_end = is_off || probe.pose_age >= start_.zero_force_age - kAgeTolerance;
  if (!(size == 0 && may_end) && step > slew * start_.period + kTolerance)
    report(probe.cycle, name + " changes faster than its slew limit");
  return step;
}

void ForceChecker::check(const trace::FlightProbe& probe) {
  if (probe.cycle <= checked_) return;
  const auto found = before_.find(probe.probe);
  // After a cycle that no recording contains, the change is unknown.
  const trace::FlightProbe& before =
      found != before_.end() && found->second.cycle + 1 == probe.cycle ? found->second : probe;
  double max_force = start_.max_force, max_torque = start_.max_torque;
  if (probe.probe < start_.devices.size()) {
    max_force = std::min(max_force, start_.devices[probe.probe].max_force);
    max_torque = std::min(max_torque, start_.devices[probe.probe].max_torque);
  }
  max_force_ = std::max(max_force_, norm(probe.force));
  max_step_ = std::max(max_step_, check(probe, "force", probe.force, before.force, max_force, start_.max_slew));
  check(probe, "torque", probe.torque, before.torque, max_torque, start_.max_torque_slew);
  before_[probe.probe] = probe;
}

void ForceChecker::check(const trace::FlightTouch& touch) {
  if (touch.cycle <= checked_) return;
  if (checked_ != 0) {
    missing_ += touch.cycle - checked_ - 1;
    if (touch.time_ns <= time_ns_) report(touch.cycle, "its time is not after that of the cycle before");
  }
  checked_ = touch.cycle;
  time_ns_ = touch.time_ns;
  ++cycles_;
}

void ForceChecker::check(const std::filesystem::path& recording) {
  trace::FlightFileReader reader{recording};
  for (trace::FlightMessage message; reader.next(message);) {
    if (auto* start = std::get_if<trace::FlightStart>(&message)) start_ = std::move(*start);
    if (const auto* probe = std::get_if<trace::FlightProbe>(&message)) check(*probe);
    if (const auto* touch = std::get_if<trace::FlightTouch>(&message)) check(*touch);
  }
}

void CycleLog::poll() {
  static const std::regex kRecorded{"flight recording (\\S+): [0-9]+ cycles"};
  const std::string output = hrtc_.output();
  // The last line may be incomplete.
  const std::size_t end = output.rfind('\n') == std::string::npos ? read_ : output.rfind('\n') + 1;
  for (std::sregex_iterator at{output.begin() + static_cast<std::ptrdiff_t>(read_),
                               output.begin() + static_cast<std::ptrdiff_t>(end), kRecorded},
       none;
       at != none; ++at) {
    checker_.check((*at)[1].str());
    std::filesystem::remove((*at)[1].str());
  }
  read_ = end;
  const std::int64_t now_ns = realtime::monotonic_ns();
  if (now_ns - requested_ns_ < kRequestNs) return;
  requested_ns_ = now_ns;
  hrtc_.signal(SIGUSR1);
}

}  // namespace tactus::bench
