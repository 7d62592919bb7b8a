/// The path of the tips and the files that all tests of flight recordings use.
#pragma once

#include <cmath>
#include <filesystem>
#include <vector>

#include "hrtc_service/flight_replay.hpp"
#include "spm/codec/model_codec.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service::flight_support {

constexpr double kSphereRadius = 0.05;  // m

/// Returns a position at which a tip of 3 mm is 0.5 mm deep in the sphere of kSphereRadius around the origin. `angle`:
/// rad along a path that winds around this sphere.
inline spm::Vec3d position_on_sphere(double angle) {
  return 0.0525 *
         spm::Vec3d{std::cos(angle), std::sin(angle) * std::cos(angle / 7), std::sin(angle) * std::sin(angle / 7)};
}

/// Options of a replay in which all objects have this model, which must outlive the options.
inline FlightReplayOptions replay_options(const spm::codec::EncodedModel& encoded) {
  FlightReplayOptions options;
  options.model = [&encoded](std::uint64_t digest) {
    return digest == encoded.compressed().summary().digest ? &encoded.compressed() : nullptr;
  };
  return options;
}

inline std::vector<trace::FlightMessage> read_messages(const std::filesystem::path& file) {
  std::vector<trace::FlightMessage> messages;
  trace::FlightFileReader reader{file};
  for (trace::FlightMessage message; reader.next(message);) messages.push_back(message);
  return messages;
}

inline void write_messages(const std::filesystem::path& file, const std::vector<trace::FlightMessage>& messages) {
  trace::FlightFileWriter writer{file};
  for (const trace::FlightMessage& message : messages) writer.write(message);
  writer.close();
}

}  // namespace tactus::hrtc_service::flight_support
