/// A recording of a session.
#include "tests/fuzz/target.hpp"
#include "trace/mcap.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const tactus::fuzz::MemoryFile file{{data, size}};
  try {
    tactus::trace::McapReader reader{file.path()};
    tactus::trace::McapMessage message;
    while (reader.next(message)) {
    }
  } catch (const tactus::trace::McapError&) {
  }
  return 0;
}
