/// Computes the forces of a flight recording again, and reports where they differ from the recorded ones.
///
/// A separate cycle receives the recorded calls, with the granted refinement as its budget and without a clock. The
/// regions come from the model files, which the recording names by digest. The content of a slot depends only on the
/// model's record, not on its index or the time of loading, so the replay needs neither host nor loader. The same build
/// gives the same bits. One thread; allocates; does not wait for real time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "hrtc_service/cycle.hpp"
#include "spm/codec/compressed_model.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

struct FlightReport {
  trace::FlightStart start;
  bool from_the_beginning = false;  ///< from the start of the HRTC, not from the middle of its run
  bool cut = false;                 ///< the file ends without its end
  std::uint64_t cycles = 0, lost = 0, gaps = 0;
  double seconds = 0;  ///< from the first to the last cycle
  // The amount of work, so that a reader sees that the recording is not empty.
  std::uint64_t probe_cycles = 0, in_contact = 0, exact = 0, stale = 0, faulted = 0;
  std::uint64_t objects = 0, objects_withdrawn = 0, regions_came = 0, regions_left = 0, moves = 0, stops = 0,
                resets = 0;
  std::uint64_t budget_spent = 0;  ///< cycles in which refinement was stopped
  std::uint64_t differ = 0;        ///< cycles with any difference
  std::string first_difference;    ///< cycle, recorded value, replayed value
  std::string given_up;            ///< the reason when a recorded call became impossible; else empty
};

struct FlightReplayOptions {
  /// Null when there is no such model; must stay valid.
  std::function<const spm::codec::CompressedModel*(std::uint64_t digest)> model;
  /// Receives each probe in each cycle, when set.
  std::function<void(const trace::FlightTouch&, const trace::FlightProbe&, const ProbeOutput&)> on_probe;
  /// Also replays a recording of another build if it begins at the start: forces may differ.
  bool any_build = false;
  /// Limit of the pool that a recording may request; a larger one is refused.
  std::uint64_t max_pool_bytes = std::uint64_t{16} << 30;
};

/// Throws trace::FlightError or McapError, with the value found and the value expected, for a file that is no flight
/// recording, is of another build, or contains an object without its model.
[[nodiscard]] FlightReport replay_flight(const std::filesystem::path& file, const FlightReplayOptions& options);

}  // namespace tactus::hrtc_service
