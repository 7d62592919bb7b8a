/// Conversions between session samples and simulated bodies, for movable objects.
///
///     catalogue entry --> SharedBody      object_pose <--> BodyState <--> object_copy
///
/// A body frame has the axes of the model. Its origin is the centre of mass, which is the centre of the bounds.
/// World frame, SI. Conversions allocate only for a message that contains a list.
#pragma once

#include "haptics/coupling.hpp"
#include "haptics/rigid_body.hpp"
#include "session/messages.hpp"

namespace tactus::sharing {

using haptics::BodyState;
using haptics::Vec3d;

static_assert(haptics::kMaxCopies == session::kMaxTouchers);

/// A movable object as haptics simulates it.
struct SharedBody {
  haptics::BodySettings settings;  ///< the box of the bounds collides with the ground and with static objects
  Vec3d centre = Vec3d::Zero();    ///< centre of mass, model frame times scale, m
  double ground = 0;               ///< m, height of the ground plane
  BodyState start;                 ///< at rest at the catalogue pose
};

[[nodiscard]] inline bool can_move(const session::CatalogueEntry& entry) noexcept { return entry.body.mass > 0; }
/// A body with default mass and friction, whose box and centre are those of the bounds.
[[nodiscard]] SharedBody body_of_bounds(const spm::ModelSummary& summary, double scale) noexcept;
/// The body of a movable object.
[[nodiscard]] SharedBody body_of(const session::CatalogueEntry& entry) noexcept;
/// Principal moments of a box of uniform density that has the size of the bounds, kg m^2.
[[nodiscard]] std::array<double, 3> inertia_of_bounds(const spm::ModelSummary& summary, double scale,
                                                      double mass) noexcept;

/// The state of a resting body whose model is at `pose`.
[[nodiscard]] BodyState state_at(const session::Pose& pose, const Vec3d& centre) noexcept;
[[nodiscard]] session::Pose pose_of(const BodyState& state, const Vec3d& centre) noexcept;

/// The state of a body from its object_pose, whose velocity is that of the model's origin.
[[nodiscard]] BodyState state_of(const session::ObjectPose& pose, const Vec3d& centre) noexcept;
/// Fills pose, velocity and angular velocity of an object_pose.
void put_state(const BodyState& state, const Vec3d& centre, session::ObjectPose& pose) noexcept;

/// The copy sample in an object_copy that the caller has validated (session/check.hpp).
[[nodiscard]] haptics::CopySample sample_of(const session::ObjectCopy& copy) noexcept;
/// Fills time, body state, user force and `count` channels of an object_copy. Allocates.
void put_sample(const haptics::CopySample& sample, std::size_t count, session::ObjectCopy& copy);

/// Extrapolates `state` by `seconds` at its velocity.
[[nodiscard]] BodyState extrapolated(const BodyState& state, double seconds) noexcept;

}  // namespace tactus::sharing
