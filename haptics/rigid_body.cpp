#include "haptics/rigid_body.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace tactus::haptics {

namespace {

constexpr double kContactReach = 0.005;  // m; at 1 kHz a point needs 5 m/s to jump it

Eigen::Matrix3d skew(const Vec3d& v) noexcept {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

}  // namespace

BodySettings box_body(double mass, const Vec3d& half_extents) noexcept {
  BodySettings settings;
  settings.mass = mass;
  const Vec3d squares = half_extents.cwiseAbs2();
  settings.inertia = mass / 3 * (Vec3d::Constant(squares.sum()) - squares);
  settings.point_count = 8;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d signs{corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0};
    settings.points[static_cast<std::size_t>(corner)] = half_extents.cwiseProduct(signs);
  }
  return settings;
}

Eigen::Quaterniond rotation_by(const Vec3d& turn) noexcept {
  const double angle = turn.norm();
  const double share = angle > 1e-9 ? std::sin(angle / 2) / angle : 0.5;
  return Eigen::Quaterniond{std::cos(angle / 2), share * turn.x(), share * turn.y(), share * turn.z()};
}

Vec3d turn_of(const Eigen::Quaterniond& rotation) noexcept {
  const double sign = rotation.w() < 0 ? -1 : 1;
  const double sine = rotation.vec().norm();
  const double angle = 2 * std::atan2(sine, sign * rotation.w());
  return sine > 1e-12 ? Vec3d(rotation.vec() * (sign * angle / sine)) : Vec3d(2 * sign * rotation.vec());
}

Eigen::Matrix3d RigidBody::inertia_world() const noexcept {
  const Eigen::Matrix3d axes = state_.orientation.toRotationMatrix();
  return axes * settings_.inertia.asDiagonal() * axes.transpose();
}

void RigidBody::begin(double dt) noexcept {
  dt_ = dt;
  const Eigen::Matrix3d inertia = inertia_world();
  mass_.setZero();
  mass_.topLeftCorner<3, 3>().diagonal().setConstant(settings_.mass + dt * settings_.damping);
  mass_.bottomRightCorner<3, 3>() = inertia;
  mass_.bottomRightCorner<3, 3>().diagonal().array() += dt * settings_.spin_damping;
  momentum_.head<3>() = settings_.mass * (state_.velocity + dt * settings_.gravity);
  momentum_.tail<3>() = inertia * state_.spin;
}

void RigidBody::add_force(const Vec3d& point_world, const Vec3d& force) noexcept {
  momentum_.head<3>() += dt_ * force;
  momentum_.tail<3>() += dt_ * (point_world - state_.position).cross(force);
}

void RigidBody::add_spring(const PointSpring& spring) noexcept {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << Eigen::Matrix3d::Identity(), -skew(spring.point - state_.position);
  mass_ += dt_ * (dt_ * spring.stiffness + spring.damping) * jacobian.transpose() * jacobian;
  add_force(spring.point, spring.force(Vec3d::Zero(), dt_));
}

void RigidBody::add_spring(const TurnSpring& spring) noexcept {
  mass_.bottomRightCorner<3, 3>().diagonal().array() += dt_ * (dt_ * spring.stiffness + spring.damping);
  momentum_.tail<3>() += dt_ * spring.torque(Vec3d::Zero(), dt_);
}

void RigidBody::add_implicit(const Mat6d& mass, const Vec6d& impulse) noexcept {
  mass_ += mass;
  momentum_ += impulse;
}

SolverBody RigidBody::free() const noexcept {
  SolverBody body;
  body.inverse_mass = mass_.llt().solve(Mat6d::Identity());
  body.velocity = body.inverse_mass * momentum_;
  return body;
}

void RigidBody::finish(const Vec6d& velocity) noexcept {
  const Vec3d spin = velocity.tail<3>();
  const Vec3d turning = inertia_world() * spin;  // angular momentum: stays while the body turns on
  const Eigen::Quaterniond before = state_.orientation;
  const auto spin_at = [&](const Eigen::Quaterniond& orientation) -> Vec3d {
    return orientation * (orientation.conjugate() * turning).cwiseQuotient(settings_.inertia);
  };
  const Vec3d middle = spin_at(rotation_by(dt_ / 2 * spin) * before);
  state_.orientation = (rotation_by(dt_ * middle) * before).normalized();
  state_.spin = spin_at(state_.orientation);
  state_.velocity = velocity.head<3>();
  state_.position += dt_ * state_.velocity;
}

double RigidBody::kinetic_energy() const noexcept {
  return 0.5 * (settings_.mass * state_.velocity.squaredNorm() + state_.spin.dot(inertia_world() * state_.spin));
}

double RigidBody::top_speed() const noexcept {
  double fastest = state_.velocity.norm();
  for (std::uint32_t i = 0; i < settings_.point_count; ++i) {
    fastest = std::max(fastest, (state_.velocity + state_.spin.cross(state_.orientation * settings_.points[i])).norm());
  }
  return fastest;
}

void add_ground_contacts(const RigidBody& body, std::uint32_t index, double height, ContactSolver& solver) noexcept {
  const BodySettings& settings = body.settings();
  for (std::uint32_t i = 0; i < settings.point_count; ++i) {
    Contact contact;
    contact.point = body.state().to_world(settings.points[i]);
    contact.gap = contact.point.z() - height;
    if (contact.gap > kContactReach) continue;
    contact.id = (std::uint64_t{index} << 32) | (1u << 24) | i;
    contact.a = index;
    contact.arm_a = contact.point - body.state().position;
    contact.friction = settings.friction;
    solver.add(contact);
  }
}

void add_surface_contacts(const RigidBody& body, std::uint32_t index, const Surface& surface,
                          ContactSolver& solver) noexcept {
  const BodySettings& settings = body.settings();
  for (std::uint32_t i = 0; i < settings.point_count; ++i) {
    const Vec3d point = body.state().to_world(settings.points[i]);
    SurfaceHit hit;
    if (!surface.closest(point, kContactReach, hit) || !hit.sided) continue;
    Contact contact;
    contact.id = (std::uint64_t{index} << 32) | (2u << 24) | i;
    contact.a = index;
    contact.point = point;
    contact.arm_a = point - body.state().position;
    contact.normal = hit.normal;
    contact.gap = hit.distance;
    contact.friction = settings.friction;
    solver.add(contact);
  }
}

}  // namespace tactus::haptics
