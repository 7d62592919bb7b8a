/// An HRTC: joins a session, finds the objects of all hosts, gives users probes, and lets them feel.
///
///   thread   runs                                              woken by
///   haptic   devices, cycle                                    its period
///   sender   probe states                                      its own timer
///   service  roster, clock, loader, metrics, log               samples that arrive, else every 2 ms
///   flight   what is kept of the last cycles                   20 ms
///   (DDS)    callbacks that copy a sample into the inbox;      the network
///            those of stops and resets set the haptic thread's stop themselves
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
  /// A tool, m, that every user holds in place of a sphere; core.servo.cycle.tool is to be this one. Null: none.
  std::unique_ptr<const spm::MeshProbe> tool;
  wire::SessionAddress address;
  HrtcCoreSettings core;
  HapticSettings haptic;
  std::uint32_t max_users = kMaxProbes;
  std::vector<LocalUser> local_users;
  std::filesystem::path log;       ///< contact log; empty: none
  std::filesystem::path snapshot;  ///< directory for the shown meshes; empty: none
  FlightOptions flight;            ///< what is kept of the last cycles
  /// Grows when what is kept of the last cycles shall be written; null: nobody asks.
  const std::atomic<std::uint32_t>* saves = nullptr;
  double host_patience = 0;   ///< s to wait for a first host; 0: for ever
  bool timer_beside = false;  ///< measure a bare timer of the same priority
  double state_rate = 1000;   ///< Hz of probe states, at most the cycle's
  bool coding = true;         ///< to the session only states that a receiver would miss; false: all
};

class Hrtc {
 public:
  /// Throws for whatever cannot be had: names, domain, profiles, files. Nothing runs yet.
  explicit Hrtc(HrtcOptions options);
  ~Hrtc();

  /// Until `stop` is set, the session ends, or a reason to give up; 0 or the exit code, with the reason logged.
  int run(const std::atomic<bool>& stop);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::hrtc_service
