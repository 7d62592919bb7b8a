/// The hand of a user who points at a target, for example with a mouse. The hand moves in a straight line and with
/// constant speed from its present position to the newest target, and stays there. It rotates during the same time.
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
  [[nodiscard]] session::Intent move_to(const session::Pose& target, std::int64_t session_now_ns) {
    from_ = has_position_ ? pose(session_now_ns) : target;
    to_ = target;
    has_position_ = true;
    double distance2 = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double difference = to_.position[axis] - from_.position[axis];
      distance2 += difference * difference;
    }
    from_ns_ = session_now_ns;
    to_ns_ = session_now_ns + std::max(kMinMotionNs, static_cast<std::int64_t>(std::sqrt(distance2) / kSpeed * 1e9));
    session::Intent intent;
    intent.path = {{from_ns_, from_}, {to_ns_, to_}};
    return intent;
  }

 private:
  [[nodiscard]] session::Pose pose(std::int64_t session_now_ns) const {
    const double share =
        std::clamp(static_cast<double>(session_now_ns - from_ns_) / static_cast<double>(to_ns_ - from_ns_), 0.0, 1.0);
    session::Pose at;
    for (std::size_t axis = 0; axis < 3; ++axis)
      at.position[axis] = from_.position[axis] + share * (to_.position[axis] - from_.position[axis]);
    at.orientation = orientation(share);
    return at;
  }

  /// Returns the normalised weighted sum of both orientations, which differs little from that of the simulated hand.
  [[nodiscard]] std::array<double, 4> orientation(double share) const {
    const std::array<double, 4>&a = from_.orientation, &b = to_.orientation;
    if (a == b) return b;  // exactly, without rounding
    const double sign = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0 ? -1 : 1;  // q and -q are the same
    std::array<double, 4> sum;
    double square = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      sum[i] = (1 - share) * a[i] + share * sign * b[i];
      square += sum[i] * sum[i];
    }
    for (double& number : sum) number /= std::sqrt(square);  // at least 1/sqrt(2), because of `sign`
    return sum;
  }

  session::Pose from_, to_;
  std::int64_t from_ns_ = 0, to_ns_ = 0;
  bool has_position_ = false;
};

}  // namespace tactus::sharing
