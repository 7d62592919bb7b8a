/// The service HRTC: joins a session, loads the objects of all hosts, gives probes to users and computes their forces.
///
///   thread   runs                                              woken by
///   haptic   devices, cycle                                    its period
///   sender   probe states                                      its own timer
///   service  roster, clock, loader, metrics, log               samples that arrive, else every 2 ms
///   flight   the flight recorder                               20 ms
///   (DDS)    callbacks that copy a sample into the inbox;      the network
///            those of stops and resets stop the haptic thread directly
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "hrtc_service/flight_saver.hpp"
#include "hrtc_service/haptic_thread.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "wire/participants.hpp"

namespace tactus::hrtc_service {

/// A user of this HRTC whose device is at this machine.
struct LocalUser {
  std::string user;
  std::unique_ptr<haptics::Device> device;
};

struct HrtcOptions {
  /// The tool of every user, m, instead of a sphere; core.servo.cycle.tool must point to it. Null: none.
  std::unique_ptr<const spm::MeshProbe> tool;
  wire::SessionAddress address;
  HrtcCoreSettings core;
  HapticSettings haptic;
  std::uint32_t max_users = kMaxProbes;
  std::vector<LocalUser> local_users;
  std::filesystem::path log;       ///< contact log; empty: none
  std::filesystem::path snapshot;  ///< directory for snapshots; empty: none
  FlightOptions flight;            ///< of the flight recorder
  /// Increases with each request of an operator to write the flight recording; null: no such requests.
  const std::atomic<std::uint32_t>* saves = nullptr;
  double host_patience = 0;   ///< s to wait for a first host; 0: without limit
  bool timer_beside = false;  ///< measure a bare timer of the same priority
  double state_rate = 1000;   ///< Hz of probe states, at most the cycle's
  bool coding = true;         ///< deadband-coded states for the session; false: all states
};

class Hrtc {
 public:
  /// Throws for an invalid name, domain, profile or file. Starts no thread.
  explicit Hrtc(HrtcOptions options);
  ~Hrtc();

  /// Runs until `stop` is set, the session ends, or an error. Returns 0 or the exit code, and logs the reason.
  int run(const std::atomic<bool>& stop);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::hrtc_service
