/// The hand of a user who points at a target, for example with a mouse. The hand moves in a straight line and with
/// constant speed from its present position to the newest target, and stays there.
///
/// Metres, world frame; times are session time. No clock; one thread at a time. Not realtime.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "session/messages.hpp"

namespace tactus::sharing {

class PointedHand {
 public:
  static constexpr double kSpeed = 0.5;  ///< m/s
  static constexpr std::int64_t kMinMotionNs =
      20'000'000;  ///< min duration of a motion, so that near targets cause no step

  /// Returns an intent with the path from the present position to `target`, without origin, user and sequence number.
  /// The first target is the start position.
  [[nodiscard]] session::Intent move_to(const std::array<double, 3>& target, std::int64_t session_now_ns) {
    from_ = has_position_ ? position(session_now_ns) : target;
    to_ = target;
    has_position_ = true;
    double distance2 = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) distance2 += (to_[axis] - from_[axis]) * (to_[axis] - from_[axis]);
    from_ns_ = session_now_ns;
    to_ns_ = session_now_ns + std::max(kMinMotionNs, static_cast<std::int64_t>(std::sqrt(distance2) / kSpeed * 1e9));
    session::Intent intent;
    intent.path = {{from_ns_, {from_, {0, 0, 0, 1}}}, {to_ns_, {to_, {0, 0, 0, 1}}}};
    return intent;
  }

 private:
  [[nodiscard]] std::array<double, 3> position(std::int64_t session_now_ns) const {
    const double share =
        std::clamp(static_cast<double>(session_now_ns - from_ns_) / static_cast<double>(to_ns_ - from_ns_), 0.0, 1.0);
    std::array<double, 3> at;
    for (std::size_t axis = 0; axis < 3; ++axis) at[axis] = from_[axis] + share * (to_[axis] - from_[axis]);
    return at;
  }

  std::array<double, 3> from_{}, to_{};
  std::int64_t from_ns_ = 0, to_ns_ = 0;
  bool has_position_ = false;
};

}  // namespace tactus::sharing
