#include "hrtc_service/servo/servo_runner.hpp"

#include <malloc.h>
#include <pthread.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "realtime/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMinPeriodNs = 1'000'000;        // of the intake thread
constexpr std::int64_t kMinSnapshotNs = 1'000'000'000;  // between two snapshots, during which nothing is refined

std::array<haptics::DeviceSpec, kMaxProbes> specs_of(const ServoOptions& options) {
  std::array<haptics::DeviceSpec, kMaxProbes> specs;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (options.local[i] != nullptr) {
      haptics::DeviceSpec spec = options.local[i]->spec();
      spec.max_force = std::min(spec.max_force, options.servo.cycle.force.max_force);
      specs[i] = options.haptic.frame.to_world(spec);
    } else if (options.servo.cycle.tool != nullptr) {  // a client itself limits the torque to that of its device
      specs[i].max_torque = options.servo.cycle.force.max_torque;
    }
  return specs;
}

std::unique_ptr<FlightSaver> flight_saver(const ServoOptions& options) {
  if (options.flight.seconds <= 0) return nullptr;
  // Each second of a recording gets pages of its own, which the system gets back. Without this, malloc takes the memory
  // of later ones from the heap, where those of other sizes do not fit into the gaps, so that the program grows.
  constexpr int kOwnPagesFrom = 128 << 10;
  (void)::mallopt(M_MMAP_THRESHOLD, kOwnPagesFrom);
  return std::make_unique<FlightSaver>(
      options.flight, flight_start(options.participant, options.servo.cycle, options.pool, specs_of(options)),
      std::min(options.max_users, kMaxProbes));
}

ServoSettings servo_settings(const ServoOptions& options, FlightSaver* flight) {
  ServoSettings settings = options.servo;
  settings.specs = specs_of(options);
  settings.recorder = flight == nullptr ? nullptr : &flight->recorder();
  return settings;
}

/// Copies the settings that cycle and haptic thread share.
ServoOptions with_shared_settings(ServoOptions options) {
  const haptics::ForceSettings& force = options.servo.cycle.force;
  options.haptic.period = options.servo.cycle.period;
  options.haptic.limits = {force.max_force, force.max_slew, force.max_speed, force.recovery, options.haptic.period};
  return options;
}

}  // namespace

ServoRunner::ServoRunner(const ServoOptions& options, ServoLink& link, ContactQuery::LogRing* log)
    : options_{with_shared_settings(options)},
      flight_{flight_saver(options)},
      intake_{options.pool, link.intake, options.directory_bytes},
      body_intake_{intake_.objects(), link.bodies},
      servo_{servo_settings(options, flight_.get()), link, intake_, body_intake_.orders(), log},
      haptic_{options_.haptic, servo_, link, options.local},
      usages_{link.usages},
      flight_requests_{link.flight_requests},
      parts_{link.snapshot_parts} {}

ServoRunner::~ServoRunner() { end_threads(); }

void ServoRunner::start() {
  using session::Severity;
  if (options_.haptic.priority > 0) report(Severity::kInfo, realtime::lock_memory());
  if (flight_) {
    flight_->on_event = [this](bool is_warning, const std::string& text) {
      report(is_warning ? Severity::kWarning : Severity::kInfo, text);
    };
    flight_->start();
    char text[96];
    std::snprintf(text, sizeof text, "flight recorder: the last %g s, %.1f MiB at most", options_.flight.seconds,
                  static_cast<double>(flight_->max_bytes()) / (1 << 20));
    report(Severity::kInfo, text);
  }
  report(Severity::kInfo, haptic_.start());
  running_ = true;
  thread_ = std::thread{[this] { run(); }};
}

void ServoRunner::end_threads() {
  haptic_.stop();
  running_ = false;
  if (thread_.joinable()) thread_.join();
}

bool ServoRunner::stop() {
  end_threads();
  if (!flight_) return true;
  save_flights();  // requests since the last pass
  return flight_->stop();
}

void ServoRunner::run() {
  pthread_setname_np(pthread_self(), "intake");
  while (running_) {
    realtime::sleep_until(next_pass_ns(realtime::monotonic_ns()));
    intake_.tick();
    body_intake_.tick();
    const bool was_broken = std::exchange(is_broken_, intake_.is_broken());
    if (is_broken_ && !was_broken)
      report(session::Severity::kError, "the gateway sent an invalid message, so no further regions are loaded");
    const std::int64_t now_ns = realtime::monotonic_ns();
    haptic_.usage().sample(now_ns);
    haptic_.usage().drain([this](const ThreadUsage& usage) { (void)usages_.push(usage); });
    if (flight_) save_flights();
    send_snapshot(now_ns);
  }
}

/// Returns when the intake thread wakes next: once in each cycle, or every millisecond if cycles are shorter. It wakes
/// late in a cycle, because a reading of the haptic thread's counters is exact while that thread sleeps.
std::int64_t ServoRunner::next_pass_ns(std::int64_t now_ns) const noexcept {
  const std::int64_t cycle_ns = options_.haptic.period_ns();
  const std::int64_t period_ns = std::max<std::int64_t>(kMinPeriodNs / cycle_ns, 1) * cycle_ns;
  const std::int64_t late_in_cycle_ns = haptic_.next_due_ns() - cycle_ns * 2 / 5;
  const std::int64_t passed_ns = std::max<std::int64_t>(now_ns - late_in_cycle_ns, 0);
  return late_in_cycle_ns + (passed_ns / period_ns + 1) * period_ns;
}

void ServoRunner::save_flights() {
  FlightRequest request;
  for (std::uint32_t left = ServoLink::kFlightRequests; left > 0 && flight_requests_.pop(request); --left) {
    request.reason.back() = '\0';
    flight_->save(request.reason.data(), false);
  }
  if (options_.save_requests == nullptr) return;
  const std::uint32_t requests = options_.save_requests->load();
  if (std::exchange(saves_seen_, requests) != requests) flight_->save("requested by a signal", true);
}

/// Sends the faces of a snapshot as soon as the haptic thread has copied it.
void ServoRunner::send_snapshot(std::int64_t now_ns) {
  const std::uint32_t done = servo_.snapshots_done();
  if (unsent_.empty() && done != snapshots_sent_ && now_ns - snapshot_sent_ns_ >= kMinSnapshotNs) {
    snapshots_sent_ = done;
    snapshot_sent_ns_ = now_ns;
    unsent_.push_back({});  // the end
    for (std::uint32_t object = kMaxObjects; object-- > 0;)
      for (const SnapshotFace& face : servo_.snapshot(object)) unsent_.push_back({object, face});
    servo_.release_snapshot();
  }
  while (!unsent_.empty() && parts_.push(unsent_.back())) unsent_.pop_back();
  if (unsent_.empty()) std::vector<SnapshotPart>{}.swap(unsent_);
}

}  // namespace tactus::hrtc_service
