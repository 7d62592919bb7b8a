/// A session of hosts and HRTCs in one thread, over a network that loses, delays, doubles and corrupts by a seed.
///
/// The programs are DeliveryServer, DeliveryClient and Roster as they are; the network and the cache of an HRTC are
/// models. Time goes in steps of one millisecond. Same seed, same run.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tactus::test_support {

/// Chances are per sample.
struct Faults {
  double loss = 0;
  double duplication = 0;
  double corruption = 0;  ///< of a chunk's payload
  double reordering = 0;  ///< a further delay of up to `reorder_ms`
  int reorder_ms = 0;
  double host_crash = 0;  ///< per host and second
  double hrtc_crash = 0;  ///< per HRTC and second
  double partition = 0;   ///< of a host and an HRTC, per pair and second
  int decode_ms = 0;      ///< an HRTC answers for a message up to so much later
  double parking = 0;     ///< of its messages, as if they waited for room
};

/// A mix that depends on the seed alone; among the mixes each kind of fault is sometimes missing.
[[nodiscard]] Faults random_faults(std::uint64_t seed);

struct SimulationResult {
  std::vector<std::string> broken;  ///< what must never be and was, in words
  bool converged = false;           ///< every HRTC holds all that it wants, and the network is silent
  std::uint64_t chunks = 0;
  std::uint64_t regions_held = 0;  ///< accepted by an HRTC's cache
  std::uint64_t regions_refused = 0;
  std::uint64_t records_repeated = 0;  ///< came although a region that was never retired had them
  std::uint64_t regions_released = 0;
  std::uint64_t host_changes = 0;
  std::uint64_t crashes = 0;
};

/// `hrtcs` controllers wander over two objects for `wander_ms` among faults; then faults and wandering stop and the
/// session has ten seconds to converge.
[[nodiscard]] SimulationResult simulate(std::uint64_t seed, const Faults& faults, int hrtcs, int wander_ms);

}  // namespace tactus::test_support
