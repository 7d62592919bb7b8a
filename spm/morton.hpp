/// Morton codes: numbers of cells in an order in which the eight parts of each cell are consecutive.
///
/// O(1), any thread.
/// Source: Morton 1966, A computer oriented geodetic data base.
#pragma once

#include <cstdint>

namespace tactus::spm {

/// The Morton code of a cell: the lowest 21 bits of x, y and z interleaved, the bits of x lowest.
[[nodiscard]] constexpr std::uint64_t morton(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
  const auto spread = [](std::uint64_t v) {
    v &= 0x1fffff;
    v = (v | v << 32) & 0x1f00000000ffff;
    v = (v | v << 16) & 0x1f0000ff0000ff;
    v = (v | v << 8) & 0x100f00f00f00f00f;
    v = (v | v << 4) & 0x10c30c30c30c30c3;
    return (v | v << 2) & 0x1249249249249249;
  };
  return spread(x) | spread(y) << 1 | spread(z) << 2;
}

}  // namespace tactus::spm
