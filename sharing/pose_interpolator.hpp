/// Where an object that somebody else simulates is shown: its newest pose, carried on to now.
///
///     poses heard     x----->        x----->          each goes on with its velocity
///     shown           ------------\__-------\___      what a new one changes is faded in
///
/// So what is shown is as current as the velocity tells, stands still when nothing is heard any more, and does not
/// jump. Session time. World frame, SI. One thread at a time. Realtime.
#pragma once

#include <cstdint>

#include "sharing/body.hpp"

namespace tactus::sharing {

/// A pose that counts (session::PoseGate), as it travels between threads.
struct ReceivedPose {
  BodyState state;
  std::int64_t session_ns = 0;
  std::uint64_t number = 0;  ///< grows with each; 0: none yet
};

class PoseInterpolator {
 public:
  explicit PoseInterpolator(const BodyState& state = {}) noexcept { show(state, 0); }

  /// It stands so, whatever was heard before; what is heard from now on starts from here.
  void show(const BodyState& state, std::int64_t session_now_ns) noexcept;
  void on_pose(const ReceivedPose& pose, std::int64_t session_now_ns) noexcept;
  [[nodiscard]] BodyState at(std::int64_t session_now_ns) const noexcept;

 private:
  static constexpr std::int64_t kLongestNs = 60'000'000;  // for which a pose is carried on
  static constexpr double kFade = 0.02;                   // s, in which a difference falls to a third

  [[nodiscard]] BodyState target(std::int64_t session_now_ns) const noexcept;

  ReceivedPose received_;
  std::int64_t faded_from_ns_ = 0;  // the two below are of then
  Vec3d off_ = Vec3d::Zero(), turned_off_ = Vec3d::Zero();
};

}  // namespace tactus::sharing
