/// Position codes: whole numbers for coordinates, in the order of their values. The code of a predicted coordinate plus
/// the residual is the code of the true coordinate, so a decoder restores the coordinate exactly.
///
/// A lossless profile has a code for each float. A compact profile has a code for each step of the coordinates' grid.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "spm/model.hpp"

namespace tactus::spm {

class PositionCode {
 public:
  explicit PositionCode(const ModelSummary& summary) noexcept
      : origin_{summary.bounds_min}, step_{summary.position_step} {}

  /// Returns the code of the value nearest to `coordinate`, which must not be below the bounds.
  [[nodiscard]] std::uint32_t encode(std::size_t axis, double coordinate) const noexcept {
    if (step_ > 0) return static_cast<std::uint32_t>((coordinate - double{origin_[axis]}) / step_ + 0.5);
    const auto value = static_cast<float>(coordinate);
    std::uint32_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    return (bits & kSign) != 0 ? ~bits : bits | kSign;
  }
  /// Returns the coordinate of a code. If `encode` did not return this code, the float may not be finite.
  [[nodiscard]] float decode(std::size_t axis, std::uint32_t code) const noexcept {
    if (step_ > 0) return static_cast<float>(double{origin_[axis]} + code * step_);
    const std::uint32_t bits = (code & kSign) != 0 ? code & ~kSign : ~code;
    float value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }

 private:
  static constexpr std::uint32_t kSign = 0x80000000u;
  std::array<float, 3> origin_;
  double step_;
};

}  // namespace tactus::spm
