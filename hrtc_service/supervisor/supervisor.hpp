/// Keeps the network part of an HRTC running while the servo runs in this process.
///
///   the gateway exits                       the HRTC ends with its exit status
///   a signal kills it                       it starts again; the servo goes on without it meanwhile
///   a signal kills it before it has joined  the HRTC ends, because it would probably be killed again
///   it is silent for 10 s                   it is killed
///
/// Main thread.
#pragma once

#include <atomic>
#include <functional>
#include <string>

#include "hrtc_service/servo/servo_link.hpp"
#include "hrtc_service/supervisor/gateway_process.hpp"
#include "session/severity.hpp"

namespace tactus::hrtc_service {

class Supervisor {
 public:
  /// The references must outlive the supervisor. `stop`: ends the HRTC. `on_event` receives lines for operators.
  Supervisor(GatewayProcess& gateway, const ServoLink& link, const std::atomic<bool>& stop,
             std::function<void(session::Severity, const std::string&)> on_event);

  /// Starts the gateway. Returns when it has ended and is not to be started again. Returns the exit status of the HRTC.
  /// Throws std::system_error if the program cannot be started.
  [[nodiscard]] int run();

 private:
  [[nodiscard]] int wait_for_end();
  [[nodiscard]] bool start_again(int signal);

  GatewayProcess& gateway_;
  const ServoLink& link_;
  const std::atomic<bool>& stop_;
  std::function<void(session::Severity, const std::string&)> on_event_;
  std::int64_t pause_ns_ = 0;  // before the next start
};

}  // namespace tactus::hrtc_service
