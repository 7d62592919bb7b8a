/// Measurements of faults in a session of real programs in two network namespaces. Each function adds its rows to the
/// report. They need root, and run in a thread that they may move into a namespace (in_own_thread).
#pragma once

#include <cstdint>

#include "bench/figures.hpp"

namespace tactus::bench {

struct FaultSettings {
  int rounds = 20;
  double seconds = 60;  ///< of a run with loss, and with random faults
  std::uint64_t seed = 1;
};

/// Kills an HRTC and starts it again.
void measure_killed_hrtc(const FaultSettings& settings, Report& report);
/// Fills a link of 2 Mbit/s with mesh data.
void measure_narrow_link(const FaultSettings& settings, Report& report);
/// Requests regions over a link that loses 5 % of the frames, and then over one that loses 1 %.
void measure_loss_of_fragments(const FaultSettings& settings, Report& report);
/// Repeats one of ten frames.
void measure_repeated_frames(const FaultSettings& settings, Report& report);
/// Limits the link of one HRTC of two.
void measure_slow_link(const FaultSettings& settings, Report& report);
/// Gives an HRTC 64 MB of memory.
void measure_small_memory(const FaultSettings& settings, Report& report);
/// Sends 10,000 packets a second of random bytes to all ports of an HRTC.
void measure_flood(const FaultSettings& settings, Report& report);
/// Runs an HRTC whose monotonic clock is an hour ahead of that of the other programs.
void measure_wrong_clock(const FaultSettings& settings, Report& report);
/// Records a session on a full disk.
void measure_full_disk(const FaultSettings& settings, Report& report);
/// Kills the host that moves an object while a second host serves it too.
void measure_body_takeover(const FaultSettings& settings, Report& report);
/// Causes random faults in a session, with `tactus chaos`.
void measure_random_faults(const FaultSettings& settings, Report& report);

}  // namespace tactus::bench
