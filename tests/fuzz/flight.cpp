/// A flight recording of an HRTC.
#include "tests/fuzz/target.hpp"
#include "trace/flight_file.hpp"
#include "trace/mcap.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const tactus::fuzz::MemoryFile file{{data, size}};
  try {
    tactus::trace::FlightFileReader reader{file.path()};
    tactus::trace::FlightMessage message;
    while (reader.next(message)) {
    }
  } catch (const tactus::trace::McapError&) {
  } catch (const tactus::trace::FlightError&) {
  }
  return 0;
}
