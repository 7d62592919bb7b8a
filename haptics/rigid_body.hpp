/// Simulates a rigid body, one step per cycle, with implicit springs and dampers. The contact solver handles contacts.
///
///     begin --> add forces, springs --> free_motion() --> [ContactSolver] --> finish(velocity)
///
/// The force of a spring is its force at the end of the step: F = K (target - point - dt v') + B (w - v'), with
/// stiffness K, damping B, time step dt, velocity v' of the point at the end of the step, and velocity w of the target.
/// The spring energy V is convex, so force times displacement is at most V before minus V after the step. So springs
/// and dampers add no energy at any stiffness. A rotation without torque conserves angular momentum; its energy changes
/// by less than 1 % (midpoint rule).
///
/// World frame, SI. The axes of the body frame are the principal axes; its origin is the centre of mass. One thread at
/// a time. Realtime throughout. Source: Baraff, Witkin 1998 (implicit springs in the mass matrix); Otaduy, Lin 2005
/// (the same for haptic coupling).
#pragma once

#include <Eigen/Geometry>
#include <array>

#include "haptics/contact_solver.hpp"
#include "haptics/surface.hpp"

namespace tactus::haptics {

inline constexpr std::size_t kMaxBodyPoints = 16;

struct BodySettings {
  double mass = 0.5;                           ///< kg
  Vec3d inertia = Vec3d::Constant(2e-4);       ///< kg m^2, about the principal axes
  Vec3d gravity{0, 0, -9.81};                  ///< m/s^2
  double damping = 0;                          ///< N s/m, drag that brings a floating body to rest
  double angular_damping = 0;                  ///< N m s
  double friction = 0.5;                       ///< coefficient, against ground and static geometry
  std::array<Vec3d, kMaxBodyPoints> points{};  ///< m, body frame; only these points can touch the ground
  std::uint32_t point_count = 0;
  Vec3d half = Vec3d::Zero();  ///< m, half edges of the box that collides with static geometry; zero: no box
};

/// Settings of a box of uniform density.
[[nodiscard]] BodySettings box_body(double mass, const Vec3d& half_extents) noexcept;

struct BodyState {
  Vec3d position = Vec3d::Zero();
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  Vec3d velocity = Vec3d::Zero();
  Vec3d angular_velocity = Vec3d::Zero();  ///< rad/s, world frame

  [[nodiscard]] Vec3d to_world(const Vec3d& point_body) const noexcept { return position + orientation * point_body; }
  [[nodiscard]] Vec3d to_body(const Vec3d& point_world) const noexcept {
    return orientation.conjugate() * (point_world - position);
  }
  [[nodiscard]] Vec3d velocity_at(const Vec3d& point_world) const noexcept {
    return velocity + angular_velocity.cross(point_world - position);
  }
};

/// Exponential map: the rotation with rotation vector `rotation` (axis times angle).
[[nodiscard]] Eigen::Quaterniond exp_map(const Vec3d& rotation) noexcept;
/// Logarithmic map: the shortest rotation vector of `rotation`.
[[nodiscard]] Vec3d log_map(const Eigen::Quaterniond& rotation) noexcept;

/// A spring and damper from a point of the body to a moving target.
struct PointSpring {
  Vec3d point = Vec3d::Zero();  ///< point of the body at the start of the step, world frame
  Vec3d target = Vec3d::Zero();
  Vec3d target_velocity = Vec3d::Zero();
  double stiffness = 0;  ///< N/m
  double damping = 0;    ///< N s/m, on the velocity relative to the target

  /// The force on the body over a step of `dt` that ends with the point's velocity `velocity`.
  [[nodiscard]] Vec3d force(const Vec3d& velocity, double dt) const noexcept {
    return stiffness * (target + dt * target_velocity - point - dt * velocity) + damping * (target_velocity - velocity);
  }
};

/// A rotational spring and damper from the body to a rotating target.
struct RotationalSpring {
  Vec3d rotation = Vec3d::Zero();  ///< rotation vector from the body to the target, world frame
  Vec3d target_angular_velocity = Vec3d::Zero();
  double stiffness = 0;  ///< N m/rad
  double damping = 0;    ///< N m s, on the angular velocity relative to the target

  /// The torque on the body over a step of `dt` that ends with `angular_velocity`.
  [[nodiscard]] Vec3d torque(const Vec3d& angular_velocity, double dt) const noexcept {
    return stiffness * (rotation + dt * (target_angular_velocity - angular_velocity)) +
           damping * (target_angular_velocity - angular_velocity);
  }
};

class RigidBody {
 public:
  explicit RigidBody(const BodySettings& settings, const BodyState& state = {}) noexcept
      : settings_{settings}, state_{state} {}

  [[nodiscard]] const BodySettings& settings() const noexcept { return settings_; }
  /// Replaces the settings from the next step on; velocities do not change.
  void change(const BodySettings& settings) noexcept { settings_ = settings; }
  [[nodiscard]] const BodyState& state() const noexcept { return state_; }
  void set_state(const BodyState& state) noexcept { state_ = state; }

  /// Begins a step of `dt` seconds, with gravity and drag.
  void begin(double dt) noexcept;
  void add_force(const Vec3d& point_world, const Vec3d& force) noexcept;
  void add_spring(const PointSpring& spring) noexcept;
  void add_spring(const RotationalSpring& spring) noexcept;
  /// Adds a force to this step whose impulse is `impulse` - `mass` * velocity, with the velocity at the end of the
  /// step.
  void add_implicit(const Mat6d& mass, const Vec6d& impulse) noexcept;
  /// The body for the contact solver: velocity without contacts, and inverse of the effective mass.
  [[nodiscard]] SolverBody free_motion() const noexcept;
  /// Ends the step with the velocity that the solver returned.
  void finish(const Vec6d& velocity) noexcept;
  /// Sets both velocities to zero.
  void stop() noexcept { state_.velocity.setZero(), state_.angular_velocity.setZero(); }

  /// Inertia about the centre, world frame.
  [[nodiscard]] Eigen::Matrix3d inertia_world() const noexcept;
  [[nodiscard]] double kinetic_energy() const noexcept;
  /// Potential energy of gravity, J; zero at the origin of the world.
  [[nodiscard]] double potential_energy() const noexcept {
    return -settings_.mass * settings_.gravity.dot(state_.position);
  }
  /// Maximum speed of the centre and of the settings' points, m/s.
  [[nodiscard]] double top_speed() const noexcept;

 private:
  BodySettings settings_;
  BodyState state_;
  double dt_ = 0;
  Mat6d mass_ = Mat6d::Zero();
  Vec6d momentum_ = Vec6d::Zero();
};

/// Calls `visit(point)` for the points of a box, body frame, from which `add_surface_contacts` begins its searches.
template <class Visit>
void for_each_box_point(const Vec3d& half, Visit&& visit) noexcept {
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z)
        if (x != 0 || y != 0 || z != 0) visit(Vec3d{x * half.x(), y * half.y(), z * half.z()});
  for (int axis = 0; axis < 3; ++axis)
    for (int corner = 0; corner < 8; ++corner) {
      Vec3d point{corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5};
      point[axis] *= 2;
      visit(Vec3d(half.cwiseProduct(point)));
    }
}

/// Adds contacts between the points of `body` and the plane z = `height`. `index`: of the body in the solver. Realtime.
void add_ground_contacts(const RigidBody& body, std::uint32_t index, double height, ContactSolver& solver) noexcept;
/// Adds contacts between the box of `body` and static geometry, at these points of the box. Realtime.
///
///     corners      8: each with the surface point closest to the corner
///     edges       12: finds the surface point P closest to the middle of the edge; contact at the point of the edge
///                     closest to P
///     faces    6 x 5: gradient ascent from the centre of the face and of its quarters to the closest surface
///
/// So it finds a bump of the surface in the middle of a face, and an edge of the surface across an edge of the box. Of
/// several bumps in one quarter of a face it finds one. It searches at most 213 closest points, about 60 on a flat
/// surface, and 1 if no surface is near.
void add_surface_contacts(const RigidBody& body, std::uint32_t index, const SurfaceDistance& surface,
                          ContactSolver& solver) noexcept;

}  // namespace tactus::haptics
