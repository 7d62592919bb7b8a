/// Coordinates as whole numbers, one for each value that a model's profile allows, in their order: so that a predicted
/// coordinate can be put right exactly.
///
/// Lossless profile: every float. Compact profile: the places of the declared grid, each of which is one float.
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

  /// Of the value nearest to `coordinate`, which is not left of the bounds.
  [[nodiscard]] std::uint32_t of(std::size_t axis, double coordinate) const noexcept {
    if (step_ > 0) return static_cast<std::uint32_t>((coordinate - double{origin_[axis]}) / step_ + 0.5);
    const auto value = static_cast<float>(coordinate);
    std::uint32_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    return (bits & kSign) != 0 ? ~bits : bits | kSign;
  }
  /// Any code gives some float; of a foreign one it may not be finite.
  [[nodiscard]] float at(std::size_t axis, std::uint32_t code) const noexcept {
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
