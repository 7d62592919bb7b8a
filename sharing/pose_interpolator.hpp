/// The shown pose of an object that another program simulates: extrapolates its newest pose to now.
///
///     received poses  x----->        x----->          extrapolated by their velocity
///     shown           ------------\__-------\___      the jump at a new pose is faded out
///
/// So the shown pose has no playout delay, stops when no poses arrive, and does not jump. Session time.
/// World frame, SI. One thread at a time. Realtime.
#pragma once

#include <cstdint>

#include "sharing/body.hpp"

namespace tactus::sharing {

/// A pose that session::PoseGate has accepted, for a mailbox between threads.
struct ReceivedPose {
  BodyState state;
  std::int64_t session_ns = 0;
  std::uint64_t number = 0;  ///< grows with each pose; 0: none yet
};

class PoseInterpolator {
 public:
  PoseInterpolator() noexcept : PoseInterpolator{BodyState{}} {}
  explicit PoseInterpolator(const BodyState& state) noexcept { show(state, 0); }

  /// Sets the shown pose and drops earlier ones. The difference to later poses fades out from here.
  void show(const BodyState& state, std::int64_t session_now_ns) noexcept;
  void on_pose(const ReceivedPose& pose, std::int64_t session_now_ns) noexcept;
  [[nodiscard]] BodyState at(std::int64_t session_now_ns) const noexcept;

 private:
  static constexpr std::int64_t kLongestNs = 60'000'000;  // max extrapolation
  static constexpr double kFade = 0.02;                   // s, in which a difference falls by a factor e

  [[nodiscard]] BodyState target(std::int64_t session_now_ns) const noexcept;

  ReceivedPose received_;
  std::int64_t faded_from_ns_ = 0;  // time of the two differences below
  Vec3d position_error_ = Vec3d::Zero(), rotation_error_ = Vec3d::Zero();
};

}  // namespace tactus::sharing
