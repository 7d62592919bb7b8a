/// Reports the state of a program to systemd, if systemd has started it as a service of Type=notify. Source of the
/// protocol: sd_notify(3). Without systemd, all functions do nothing.
///
/// The library of systemd is not used, because it would load six more libraries.
#pragma once

#include <cstdint>
#include <string>

namespace tactus::realtime {

class ServiceManager {
 public:
  /// Reads NOTIFY_SOCKET and WATCHDOG_USEC.
  ServiceManager();
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  /// Reports that the service has started. Waits while the queue of systemd is full. Any thread.
  void ready() const noexcept { send("READY=1"); }
  /// Reports that the service ends. Waits as `ready`. Any thread.
  void stopping() const noexcept { send("STOPPING=1"); }
  /// Reports that the service works, at most three times in each watchdog timeout. Call it in each pass of the main
  /// loop. systemd restarts a service that does not report within the watchdog timeout. One thread.
  void alive(std::int64_t now_ns) noexcept;

 private:
  void send(const char* state, int flags = 0) const noexcept;

  int socket_ = -1;
  std::string address_;           // path; a first zero marks an abstract one
  std::int64_t interval_ns_ = 0;  // between two reports; 0: no watchdog
  std::int64_t reported_ns_ = 0;
};

}  // namespace tactus::realtime
