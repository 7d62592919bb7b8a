/// Runs the servo of an HRTC: haptic thread, intake thread and flight recorder.
///
///     ServoLink --> intake thread --> arrivals --> haptic thread <--> devices at this machine
///               <-- reports, traces, usage, faces <--'
///
/// Exchanges data with the gateway only through the ServoLink, so that the gateway can be another process.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "hrtc_service/servo/body_intake.hpp"
#include "hrtc_service/servo/flight_saver.hpp"
#include "hrtc_service/servo/haptic_thread.hpp"
#include "hrtc_service/servo/intake.hpp"
#include "hrtc_service/servo/servo.hpp"
#include "hrtc_service/servo/servo_link.hpp"
#include "session/severity.hpp"

namespace tactus::hrtc_service {

struct ServoOptions {
  std::string participant;  ///< name of the HRTC, for recordings
  spm::PoolSettings pool;
  std::uint64_t directory_bytes = ~std::uint64_t{0};  ///< as in Intake
  ServoSettings servo;                                ///< `specs` and `recorder` are set by the runner
  HapticSettings haptic;                              ///< `period` is that of the cycle
  LocalDevices local{};
  std::uint32_t max_users = kMaxProbes;
  FlightOptions flight;
  /// Number of requests (SIGUSR1) to write the flight recording; must outlive the runner. Null: none.
  const std::atomic<std::uint32_t>* save_requests = nullptr;
};

class ServoRunner {
 public:
  /// Allocates everything. `link`, the devices and `log`, the ring of logged queries or null, must outlive the runner.
  /// Throws std::runtime_error if the file of the flight recorder cannot be written, or its folder
  /// belongs to another user.
  ServoRunner(const ServoOptions& options, ServoLink& link, ContactQuery::LogRing* log);
  ~ServoRunner();

  /// Called with a line for operators, in any thread of the runner. Set it before `start`.
  std::function<void(session::Severity, const std::string&)> on_event;

  /// Starts the threads.
  void start();
  /// Ends the threads, and writes the flight recording at the end if one is wanted. Returns false if that failed.
  bool stop();

 private:
  void run();
  [[nodiscard]] std::int64_t next_pass_ns(std::int64_t now_ns) const noexcept;
  void end_threads();
  void save_flights();
  void send_snapshot(std::int64_t now_ns);
  void report(session::Severity severity, const std::string& text) const {
    if (on_event) on_event(severity, text);
  }

  ServoOptions options_;
  std::unique_ptr<FlightSaver> flight_;  // null: no flight recorder
  Intake intake_;
  BodyIntake body_intake_;
  Servo servo_;
  HapticThread haptic_;
  std::atomic<bool> running_{false};
  std::thread thread_;

  // Intake thread only.
  RingWriter<ThreadUsage, ServoLink::kUsages> usages_;
  RingReader<FlightRequest, ServoLink::kFlightRequests> flight_requests_;
  RingWriter<SnapshotPart, ServoLink::kSnapshotParts> parts_;
  std::uint32_t saves_seen_ = 0, snapshots_sent_ = 0;
  std::int64_t snapshot_sent_ns_ = 0;
  std::vector<SnapshotPart> unsent_;  // of the newest snapshot, in reverse order
  bool is_broken_ = false;
};

}  // namespace tactus::hrtc_service
