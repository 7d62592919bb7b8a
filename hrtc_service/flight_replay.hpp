/// Computes the forces of a flight recording again, and reports where they differ from the recorded ones.
///
/// A new Cycle receives the recorded calls. Its budget in each cycle is the number of units that the recorded cycle was
/// granted (CycleCosts::granted), so no clock limits the refinement. The regions come from model files, which the
/// recording identifies by digest. The content of a slot depends only on the record in the model, not on the slot's
/// index or the time of loading. So the replay needs neither host nor loader. The same build computes the same results
/// to the bit. One thread. Allocates. Does not wait for real time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "hrtc_service/servo/cycle.hpp"
#include "spm/codec/compressed_model.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

struct FlightReport {
  trace::FlightStart start;
  bool from_the_beginning = false;  ///< the recording begins at the start of the HRTC
  bool is_truncated = false;
  std::uint64_t cycles = 0, lost = 0, gaps = 0;
  double seconds = 0;  ///< from the first to the last cycle
  // Counts of the recorded events, which show that the recording is not empty.
  std::uint64_t probe_cycles = 0, in_contact = 0, exact = 0, stale = 0, faulted = 0;
  std::uint64_t objects = 0, objects_withdrawn = 0, regions_arrived = 0, regions_departed = 0, moves = 0, stops = 0,
                resets = 0;
  std::uint64_t budget_spent = 0;      ///< cycles in which refinement spent its budget
  std::uint64_t different_cycles = 0;  ///< cycles with any difference, including incomplete ones
  std::string first_difference;        ///< cycle, recorded value, replayed value
  std::string abort_reason;            ///< reason why the replay ended early, at an impossible call; else empty
};

struct FlightReplayOptions {
  /// Returns the model with this digest, null if there is none. Models must exist until the end of the replay.
  std::function<const spm::codec::CompressedModel*(std::uint64_t digest)> model;
  /// Receives each probe in each cycle, when set.
  std::function<void(const trace::FlightTouch&, const trace::FlightProbe&, const ProbeOutput&)> on_probe;
  /// Also replays a recording of another build, if it begins at the start of the HRTC. Forces may then differ.
  bool accepts_any_build = false;
  /// Max memory of the pool. A recording that needs more is refused.
  std::uint64_t max_pool_bytes = std::uint64_t{16} << 30;
};

/// Replays a file. Throws trace::FlightError or McapError, with the value found and the value expected, if the file is
/// no flight recording, has no complete cycle, is of another build, or contains an object without a model.
[[nodiscard]] FlightReport replay_flight(const std::filesystem::path& file, const FlightReplayOptions& options);

}  // namespace tactus::hrtc_service
