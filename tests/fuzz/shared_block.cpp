/// The memory that the gateway of an HRTC can write, as its servo reads it. Each 16 bytes of the input are a write:
/// offset (4 bytes), size - 1 (1 byte, of which 3 bits count), number of cycles after it (1 byte, of which 2 bits
/// count), 2 unused bytes, and the bytes to write (8 bytes). The servo keeps its state from one input to the next.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <span>

#include "tests/fuzz/target.hpp"
#include "tests/support/damaged_link.hpp"

namespace {

struct Write {
  std::uint32_t offset;
  std::uint8_t size_minus_1, cycles;
  std::array<std::uint8_t, 2> unused;
  std::array<std::byte, 8> bytes;
};
static_assert(sizeof(Write) == 16);

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static tactus::test_support::DamagedLink link;
  link.restore();
  for (std::size_t at = 0; at + sizeof(Write) <= size; at += sizeof(Write)) {
    Write write;
    std::memcpy(&write, data + at, sizeof write);
    link.damage(write.offset % link.size(), std::span{write.bytes}.first(1 + write.size_minus_1 % 8));
    for (int cycle = 0; cycle < write.cycles % 4; ++cycle)
      if (!link.run_cycle()) std::abort();
  }
  return 0;
}
