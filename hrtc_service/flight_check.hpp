/// What a message of a flight recording must be before anything of it is used: a recording is untrusted input.
///
/// Numbers, counts and enumerators that a message holds are checked here, those that depend on the objects and regions
/// that are there where these are known (flight_replay.cpp, Forest::restore, haptics/carried.hpp). What reaches a cycle
/// from a device may be anything, as it may for a cycle that works.
#pragma once

#include <cstdint>

#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// Throws trace::FlightError with what was found and what was expected. `max_pool_bytes`: that a pool may take.
void expect_valid(const trace::FlightMessage& message, std::uint64_t max_pool_bytes);

}  // namespace tactus::hrtc_service
