/// Constants of the virtual sessions.
#pragma once

#include <cstdint>

namespace tactus::study {

inline constexpr std::int64_t kCycleNs = 1'000'000;
inline constexpr double kCycle = 1e-3;  ///< s
inline constexpr std::uint64_t kSession = 30;

}  // namespace tactus::study
