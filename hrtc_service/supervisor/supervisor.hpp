/// Keeps the gateway of an HRTC running while the servo runs in this process.
///
///   the gateway exits                        the HRTC ends with its exit status
///   a signal kills it, or it fails           it starts again; the servo goes on without it meanwhile
///   the same before its first heartbeat ever the HRTC ends, because that would probably happen again
///   its heartbeat stops for 10 s             it is killed
///
/// Main thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "hrtc_service/servo/servo_link.hpp"
#include "realtime/child_process.hpp"
#include "session/severity.hpp"

namespace tactus::hrtc_service {

class Supervisor {
 public:
  /// The references must outlive the supervisor. `stop`: ends the HRTC. `end_servo` ends the threads of the servo; it is
  /// called once, before the gateway ends. `on_event` receives lines for operators.
  Supervisor(realtime::ChildProcess& gateway, ServoLink& link, const std::atomic<bool>& stop,
             std::function<void()> end_servo, std::function<void(session::Severity, const std::string&)> on_event);

  /// Starts the gateway. Returns when it has ended and is not to be started again. Returns the exit status of the HRTC.
  /// Throws std::system_error if the program cannot be started at first.
  [[nodiscard]] int run();

 private:
  [[nodiscard]] int wait_for_end();
  [[nodiscard]] int status_at_end(int wait_status);
  [[nodiscard]] bool start_again();
  void end_servo();
  [[nodiscard]] bool is_ending() const { return stop_ || link_.ended() >= 0; }

  realtime::ChildProcess& gateway_;
  ServoLink& link_;
  const std::atomic<bool>& stop_;
  std::function<void()> end_servo_;
  std::function<void(session::Severity, const std::string&)> on_event_;
  std::int64_t pause_ns_ = 0;  // before the next start
};

}  // namespace tactus::hrtc_service
