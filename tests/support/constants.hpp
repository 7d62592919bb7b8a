/// Constants that several tests use.
#pragma once

#include <cstdint>

#include "session/units.hpp"

namespace tactus {

inline constexpr double kCycle = 1e-3;  ///< s

/// Ids of a session's parts.
inline constexpr std::uint64_t kSession = 1, kHost = 10, kOtherHost = 11, kHrtc = 20, kOtherHrtc = 21, kObject = 30;

}  // namespace tactus
