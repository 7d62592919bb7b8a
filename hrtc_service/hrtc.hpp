/// The service HRTC: joins a session, loads the objects of all hosts, gives probes to users and computes their forces.
///
///   thread   work                                              woken by
///   haptic   devices, cycle                                    timer, each cycle
///   intake   checks messages of the gateway, saves recordings  timer, each cycle
///   sender   probe states, commands, copies                    timer, after each cycle
///   service  roster, clock, loader, metrics, log               urgent samples, timer every 2 to 10 ms
///   flight   flight recorder                                   timer, every 20 ms
///   (DDS)    callbacks: copy a sample into the inbox, or       network
///            pass a stop or reset to the haptic thread
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/servo/servo_runner.hpp"
#include "wire/participants.hpp"

namespace tactus::hrtc_service {

/// A user of this HRTC whose device is at this machine.
struct LocalUser {
  std::string user;
  std::unique_ptr<haptics::Device> device;
};

struct HrtcOptions {
  /// Tool of every user, coordinates in m; core.servo.cycle.tool must point to it. Null: every probe is a sphere.
  std::unique_ptr<const spm::MeshProbe> tool;
  wire::SessionAddress address;
  HrtcCoreSettings core;
  HapticSettings haptic;
  std::uint32_t max_users = kMaxProbes;
  std::vector<LocalUser> local_users;
  std::filesystem::path log;       ///< contact log; empty: none
  std::filesystem::path snapshot;  ///< directory for snapshots; empty: none
  FlightOptions flight;
  /// As ServoOptions::save_requests.
  const std::atomic<std::uint32_t>* save_requests = nullptr;
  double host_patience = 0;      ///< max time to wait for a first host, s; 0: no limit
  bool reference_timer = false;  ///< also run and measure a ReferenceTimer at the same priority
  double state_rate = 1000;      ///< max rate of probe states, Hz
  bool uses_deadband = true;     ///< false: the session receives every probe state
};

class Hrtc {
 public:
  /// Throws if a name, domain, profile or file is invalid. Starts no thread.
  explicit Hrtc(HrtcOptions options);
  ~Hrtc();

  /// Runs until `stop` is set, the session ends, or an error. Returns 0 or the exit code, and logs the reason.
  int run(const std::atomic<bool>& stop);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::hrtc_service
