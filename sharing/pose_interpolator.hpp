/// Computes the present pose of an object that another program simulates: extrapolates the newest received pose.
///
///     received poses  x----->        x----->          extrapolated by their velocity
///     result          ------------\__-------\___      the jump at a new pose is faded out
///
/// So the resulting pose has no playout delay, does not jump, and stops when no poses arrive. Times are session time.
/// World frame, SI. One thread at a time. Realtime.
#pragma once

#include <cstdint>

#include "sharing/body.hpp"

namespace tactus::sharing {

/// A pose that session::PoseAdmission has accepted, for a mailbox between threads.
struct ReceivedPose {
  BodyState state;
  std::int64_t session_ns = 0;
  std::uint64_t number = 0;  ///< grows with each pose; 0: none yet
};

class PoseInterpolator {
 public:
  PoseInterpolator() noexcept : PoseInterpolator{BodyState{}} {}
  explicit PoseInterpolator(const BodyState& state) noexcept { set_state(state, 0); }

  /// Sets the pose and forgets the received ones. The jump to the next received pose is faded out.
  void set_state(const BodyState& state, std::int64_t session_now_ns) noexcept;
  /// Takes a received pose.
  void on_pose(const ReceivedPose& pose, std::int64_t session_now_ns) noexcept;
  /// The extrapolated state, with the faded jump.
  [[nodiscard]] BodyState state_at(std::int64_t session_now_ns) const noexcept;

 private:
  static constexpr std::int64_t kMaxExtrapolationNs = 60'000'000;
  static constexpr double kFade = 0.02;  // s, time constant of the fading

  [[nodiscard]] BodyState extrapolate_received(std::int64_t session_now_ns) const noexcept;

  ReceivedPose received_;
  std::int64_t jump_ns_ = 0;  // when the last pose was received
  // The jump at jump_ns_: the pose returned before it minus the new extrapolated pose; m, and rotation vector in rad.
  Vec3d position_jump_ = Vec3d::Zero(), rotation_jump_ = Vec3d::Zero();
};

}  // namespace tactus::sharing
