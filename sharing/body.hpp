/// An object that can move, between what the session tells of it and those who simulate it.
///
///     catalogue entry --> SharedBody      object_pose <--> BodyState <--> object_copy
///
/// A body's frame has the axes of the model and its origin at the centre of mass, that of the bounds. World frame, SI.
/// The conversions do not allocate, but for those that make a message with a list in it.
#pragma once

#include "haptics/coupling.hpp"
#include "haptics/rigid_body.hpp"
#include "session/messages.hpp"

namespace tactus::sharing {

using haptics::BodyState;
using haptics::Vec3d;

static_assert(haptics::kMaxCopies == session::kMaxTouchers);

struct SharedBody {
  haptics::BodySettings settings;  ///< meets ground and static objects with the corners of its bounds
  Vec3d centre = Vec3d::Zero();    ///< of mass, model frame times scale, m
  double ground = 0;               ///< m, height of the ground plane
  BodyState start;                 ///< where the catalogue has it
};

[[nodiscard]] inline bool can_move(const session::CatalogueEntry& entry) noexcept { return entry.body.mass > 0; }
/// Its box and where its middle is; mass and all else as they are unless said.
[[nodiscard]] SharedBody body_within(const spm::ModelSummary& summary, double scale) noexcept;
/// Of an entry that can move.
[[nodiscard]] SharedBody body_of(const session::CatalogueEntry& entry) noexcept;
/// Principal moments of a box of uniform density that has the size of the bounds, kg m^2.
[[nodiscard]] std::array<double, 3> inertia_of_bounds(const spm::ModelSummary& summary, double scale,
                                                      double mass) noexcept;

/// Where the body is when its model stands at `pose`, at rest.
[[nodiscard]] BodyState state_at(const session::Pose& pose, const Vec3d& centre) noexcept;
[[nodiscard]] session::Pose pose_of(const BodyState& state, const Vec3d& centre) noexcept;

/// Of an object_pose, whose velocity is that of the model's origin.
[[nodiscard]] BodyState state_of(const session::ObjectPose& pose, const Vec3d& centre) noexcept;
/// Fills pose, velocity and spin; the rest is the caller's.
void put_state(const BodyState& state, const Vec3d& centre, session::ObjectPose& pose) noexcept;

/// Of a sample without fault.
[[nodiscard]] haptics::CopySample sample_of(const session::ObjectCopy& copy) noexcept;
/// Fills time, body, press and `count` lines; the rest is the caller's.
void put_sample(const haptics::CopySample& sample, std::size_t count, session::ObjectCopy& copy);

/// `state` as it goes on by itself for `seconds`.
[[nodiscard]] BodyState carried_on(const BodyState& state, double seconds) noexcept;

}  // namespace tactus::sharing
