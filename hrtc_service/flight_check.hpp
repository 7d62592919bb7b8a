/// Checks each message of a flight recording before its use: a recording is untrusted input.
///
/// This file checks numbers, counts and enumerators. The checks that need the objects and regions of the replay are in
/// flight_replay.cpp, Forest::restore and haptics/carried.hpp. Device input needs no check, because a cycle accepts any
/// device input, also in a live session.
#pragma once

#include <cstdint>

#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// Throws trace::FlightError with the value found and the value expected. `max_pool_bytes`: max memory of the pool that
/// the message describes.
void expect_valid(const trace::FlightMessage& message, std::uint64_t max_pool_bytes);

}  // namespace tactus::hrtc_service
