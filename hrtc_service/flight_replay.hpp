/// Makes the forces of a flight recording again, and says where they differ from those that it holds.
///
/// A cycle of its own gets the calls of the recording, with what refinement was granted as its budget and no clock.
/// Regions are taken from the models, which are those of the recording by their digests: what a slot holds is its
/// model's record whichever slot it is, and who loaded it when does not count, so neither host nor loader has a part in
/// it. The same build gives the same bits. One thread; allocates; as fast as it goes.
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
  bool from_the_beginning = false;  ///< of the controller, not in the midst
  bool cut = false;                 ///< the file ends without its end
  std::uint64_t cycles = 0, lost = 0, gaps = 0;
  double seconds = 0;  ///< from the first to the last cycle
  // What there was to do, so that one can see that something was.
  std::uint64_t probe_cycles = 0, in_contact = 0, exact = 0, stale = 0, faulted = 0;
  std::uint64_t objects = 0, regions_came = 0, regions_left = 0, moves = 0, stops = 0, resets = 0;
  std::uint64_t budget_spent = 0;  ///< cycles in which refinement was stopped
  std::uint64_t differ = 0;        ///< cycles of which anything does
  std::string first_difference;    ///< cycle, what was recorded, what was had
  std::string given_up;            ///< why, where it went so far astray that a call cannot be made; else empty
};

struct FlightReplayOptions {
  /// Null when there is none; must stay valid.
  std::function<const spm::codec::CompressedModel*(std::uint64_t digest)> model;
  /// Told of each probe in each cycle, when set.
  std::function<void(const trace::FlightTouch&, const trace::FlightProbe&, const ProbeOutput&)> on_probe;
  /// Replays what another build recorded too, if it is from the beginning: forces may differ.
  bool any_build = false;
  /// A recording says how large its pool is; one that takes more is refused.
  std::uint64_t max_pool_bytes = std::uint64_t{16} << 30;
};

/// Throws trace::FlightError or McapError, with what was found and what was expected, for a file that is none, is of
/// another build, or has an object whose model is not given.
[[nodiscard]] FlightReport replay_flight(const std::filesystem::path& file, const FlightReplayOptions& options);

}  // namespace tactus::hrtc_service
