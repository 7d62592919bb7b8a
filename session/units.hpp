/// Units of time and their conversion.
#pragma once

#include <cstdint>

namespace tactus {

inline constexpr std::int64_t kUs = 1'000, kMs = 1'000'000;  ///< ns
inline constexpr double kNsPerS = 1e9;

}  // namespace tactus
