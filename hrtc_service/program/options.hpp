/// The options of tactus-hrtc. The processes of servo and gateway have the same arguments, and each of them reads them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "hrtc_service/servo/servo_runner.hpp"
#include "spm/prediction.hpp"
#include "wire/address/address.hpp"

namespace tactus::hrtc_service {

/// Exit status of a gateway that has failed while the servo may go on. tactus-hrtc then starts it again.
inline constexpr int kStartAgain = 75;

/// A user whose device is at this machine.
struct LocalUser {
  std::string user;
  std::string device;        ///< file with poses, or DRIVER[,CONFIG]
  bool is_replayed = false;  ///< `device` is a file with poses
};

struct HrtcOptions {
  wire::SessionAddress address;
  spm::PoolSettings pool;
  std::uint64_t directory_bytes = 256u << 20;  ///< as LoaderSettings::directory_bytes
  spm::Strategy prediction = spm::Strategy::kMixture;
  ServoSettings servo;    ///< `cycle.tool` is not set
  HapticSettings haptic;  ///< `period` is that of the cycle
  std::string tool;       ///< "stylus" or a mesh file; empty: every probe is a sphere
  std::uint32_t max_users = kMaxProbes;
  std::vector<LocalUser> local_users;
  FlightOptions flight;
  std::filesystem::path log;       ///< contact log; empty: none
  std::filesystem::path snapshot;  ///< directory for snapshots; empty: none
  double host_patience = 0;        ///< max time to wait for a first host, s; 0: no limit
  bool reference_timer = false;    ///< also run and measure a ReferenceTimer at the same priority
  double state_rate = 1000;        ///< max rate of probe states, Hz
  bool uses_deadband = true;       ///< false: the session receives every probe state
  bool one_process = false;        ///< servo and gateway run in the process tactus-gateway
  int link = -1;        ///< descriptor of the SharedBlock that tactus-hrtc shares with this gateway; -1: none
  std::string warning;  ///< for the user; empty: none
};

struct ReadOptions {
  std::optional<HrtcOptions> options;  ///< nothing: the program ends with `exit_status`, and its output says why
  int exit_status = 0;
};
[[nodiscard]] ReadOptions read_options(int argc, char** argv);

}  // namespace tactus::hrtc_service
