/// The gateway of an HRTC: joins a session, loads the objects of all hosts, gives probes to users, and publishes the
/// reports of the servo.
///
///   thread   work                                              woken by
///   sender   probe states, commands, copies                    timer, after each cycle
///   service  roster, clock, loader, metrics, log               urgent samples, timer every 2 to 10 ms
///   (DDS)    callbacks: copy a sample into the inbox, or       network
///            pass a stop or reset to the servo
///
/// servo/servo_runner.hpp has the threads of the other half, usually in another process.
#pragma once

#include <atomic>
#include <memory>

#include "hrtc_service/program/options.hpp"
#include "hrtc_service/servo/contact_query.hpp"
#include "hrtc_service/servo/servo_link.hpp"

namespace tactus::hrtc_service {

class GatewayService {
 public:
  /// Joins the session; starts no thread of its own. `link`, `log` (the ring of logged queries, null without
  /// HrtcOptions::log) and `tool` (null: every probe is a sphere) must outlive the service. Throws if a name, domain,
  /// profile or file is invalid.
  GatewayService(const HrtcOptions& options, ServoLink& link, ContactQuery::LogRing* log, const spm::MeshProbe* tool);
  ~GatewayService();

  /// Runs until `stop` is set, the session ends, or an error. Returns 0 or the exit code, and logs the reason.
  [[nodiscard]] int run(const std::atomic<bool>& stop);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::hrtc_service
