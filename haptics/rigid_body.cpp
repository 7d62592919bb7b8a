#include "haptics/rigid_body.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace tactus::haptics {

namespace {

constexpr double kContactReach = 0.005;  // m; a point that crosses it in one cycle of 1 ms has a speed of 5 m/s

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
  settings.half = half_extents;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d signs{corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0};
    settings.points[static_cast<std::size_t>(corner)] = half_extents.cwiseProduct(signs);
  }
  return settings;
}

Eigen::Quaterniond exp_map(const Vec3d& rotation) noexcept {
  const double angle = rotation.norm();
  const double share = angle > 1e-9 ? std::sin(angle / 2) / angle : 0.5;
  return Eigen::Quaterniond{std::cos(angle / 2), share * rotation.x(), share * rotation.y(), share * rotation.z()};
}

Vec3d log_map(const Eigen::Quaterniond& rotation) noexcept {
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
  mass_.bottomRightCorner<3, 3>().diagonal().array() += dt * settings_.angular_damping;
  momentum_.head<3>() = settings_.mass * (state_.velocity + dt * settings_.gravity);
  momentum_.tail<3>() = inertia * state_.angular_velocity;
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

void RigidBody::add_spring(const RotationalSpring& spring) noexcept {
  mass_.bottomRightCorner<3, 3>().diagonal().array() += dt_ * (dt_ * spring.stiffness + spring.damping);
  momentum_.tail<3>() += dt_ * spring.torque(Vec3d::Zero(), dt_);
}

void RigidBody::add_implicit(const Mat6d& mass, const Vec6d& impulse) noexcept {
  mass_ += mass;
  momentum_ += impulse;
}

SolverBody RigidBody::free_motion() const noexcept {
  SolverBody body;
  body.inverse_mass = mass_.llt().solve(Mat6d::Identity());
  body.velocity = body.inverse_mass * momentum_;
  return body;
}

void RigidBody::finish(const Vec6d& velocity) noexcept {
  const Vec3d angular_velocity = velocity.tail<3>();
  const Vec3d momentum = inertia_world() * angular_velocity;  // angular momentum, constant during the step
  const Eigen::Quaterniond before = state_.orientation;
  const auto angular_velocity_at = [&](const Eigen::Quaterniond& orientation) -> Vec3d {
    return orientation * (orientation.conjugate() * momentum).cwiseQuotient(settings_.inertia);
  };
  const Vec3d middle = angular_velocity_at(exp_map(dt_ / 2 * angular_velocity) * before);
  state_.orientation = (exp_map(dt_ * middle) * before).normalized();
  state_.angular_velocity = angular_velocity_at(state_.orientation);
  state_.velocity = velocity.head<3>();
  state_.position += dt_ * state_.velocity;
}

double RigidBody::kinetic_energy() const noexcept {
  return 0.5 * (settings_.mass * state_.velocity.squaredNorm() +
                state_.angular_velocity.dot(inertia_world() * state_.angular_velocity));
}

double RigidBody::top_speed() const noexcept {
  double fastest = state_.velocity.norm();
  for (std::uint32_t i = 0; i < settings_.point_count; ++i) {
    fastest = std::max(
        fastest, (state_.velocity + state_.angular_velocity.cross(state_.orientation * settings_.points[i])).norm());
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

namespace {

/// Finds the contacts of a body's box with a surface, numbers them, and omits duplicates.
class BoxContacts {
 public:
  BoxContacts(const RigidBody& body, std::uint32_t index, const SurfaceDistance& surface,
              ContactSolver& solver) noexcept
      : body_{body}, index_{index}, surface_{surface}, solver_{solver}, half_{body.settings().half} {
    constexpr double kMaxSearchDistance = 0.03;  // m
    search_distance_ = kContactReach + std::min(kMaxSearchDistance, 0.25 * half_.maxCoeff());
  }

  void add() noexcept {
    SurfaceHit hit;
    if (!surface_.closest(body_.state().position, half_.norm() + kContactReach, hit)) return;
    for (int corner = 0; corner < 8; ++corner)
      add_at({corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0});
    for (int axis = 0; axis < 3; ++axis)
      for (int edge = 0; edge < 4; ++edge) add_edge(axis, edge & 1 ? 1.0 : -1.0, edge & 2 ? 1.0 : -1.0);
    for (int axis = 0; axis < 3; ++axis)
      for (const double side : {-1.0, 1.0}) {
        add_face(axis, side, 0, 0);
        for (int quarter = 0; quarter < 4; ++quarter)
          add_face(axis, side, quarter & 1 ? 0.5 : -0.5, quarter & 2 ? 0.5 : -0.5);
      }
  }

 private:
  [[nodiscard]] bool closest(const Vec3d& point_body, double max_distance, SurfaceHit& hit) const noexcept {
    return surface_.closest(body_.state().to_world(point_body), max_distance, hit) && hit.is_side_known;
  }

  /// Adds the contact of a point of the box, if there is one. `at`: the point as a multiple of the half edges.
  void add_at(const Vec3d& at) noexcept {
    SurfaceHit hit;
    const Vec3d point = half_.cwiseProduct(at);
    ++number_;
    if (closest(point, kContactReach, hit)) add(body_.state().to_world(point), hit.normal, hit.distance);
  }

  void add_edge(int axis, double side, double other_side) noexcept {
    Vec3d at = Vec3d::Zero();
    at[(axis + 1) % 3] = side;
    at[(axis + 2) % 3] = other_side;
    SurfaceHit hit;
    if (!closest(half_.cwiseProduct(at), search_distance_, hit)) {
      ++number_;
      return;
    }
    at[axis] = std::clamp(body_.state().to_body(hit.point)[axis] / half_[axis], -1.0, 1.0);
    add_at(at);
  }

  /// Adds the contact at which the surface is closest to a face, or penetrates the face most. Searches by gradient
  /// ascent from the point `u`, `v` of the face.
  void add_face(int axis, double side, double u, double v) noexcept {
    constexpr double kMinFacing = 0.1;  // cosine; a surface that faces away belongs to another face or a corner
    constexpr double kMinStep = 1e-5;   // m
    constexpr int kMaxSteps = 6;
    ++number_;
    const int across = (axis + 1) % 3, along = (axis + 2) % 3;
    Vec3d at, outwards = Vec3d::Zero(), uphill_before = Vec3d::Zero();
    at[axis] = side * half_[axis];
    at[across] = u * half_[across];
    at[along] = v * half_[along];
    outwards[axis] = side;
    double step = 0.25 * std::max(half_[across], half_[along]), nearest = kContactReach;
    Vec3d nearest_point = at;
    SurfaceHit hit;
    for (int i = 0; i < kMaxSteps && closest(at, search_distance_, hit); ++i) {
      const Vec3d normal = body_.state().orientation.conjugate() * hit.normal;
      const double facing = -normal.dot(outwards);
      if (facing < kMinFacing) break;
      const double gap = hit.distance / facing;  // m, along the normal of the face, if the surface is a plane
      if (gap < nearest && gap > -kContactReach) {
        nearest = gap;
        nearest_point = at;
      }
      Vec3d uphill = -(normal + facing * outwards);
      const double steepness = uphill.norm() / facing;
      if (uphill.dot(uphill_before) < 0) step /= 2;
      const double length = std::min(step, std::abs(gap) / std::max(steepness, 1e-9));
      if (length < kMinStep || steepness < 1e-6) break;
      uphill_before = uphill;
      at = (at + length * uphill.normalized()).cwiseMax(-half_).cwiseMin(half_);
    }
    if (nearest < kContactReach)
      add(body_.state().to_world(nearest_point), body_.state().orientation * -outwards, nearest);
  }

  void add(const Vec3d& point, const Vec3d& normal, double gap) noexcept {
    constexpr double kSame = 1e-4, kParallel = 0.99;  // m, cosine
    for (std::uint32_t i = 0; i < count_; ++i)
      if ((points_[i] - point).squaredNorm() < kSame * kSame && normals_[i].dot(normal) > kParallel) return;
    points_[count_] = point;
    normals_[count_++] = normal;
    Contact contact;
    contact.id = (std::uint64_t{index_} << 32) | (2u << 24) | number_;
    contact.a = index_;
    contact.point = point;
    contact.arm_a = point - body_.state().position;
    contact.normal = normal;
    contact.gap = gap;
    contact.friction = body_.settings().friction;
    solver_.add(contact);
  }

  static constexpr std::uint32_t kMax = 8 + 12 + 30;
  const RigidBody& body_;
  std::uint32_t index_;
  const SurfaceDistance& surface_;
  ContactSolver& solver_;
  Vec3d half_;
  double search_distance_ = 0;  // m
  std::uint32_t number_ = 0;    // of the last point that was searched
  std::array<Vec3d, kMax> points_, normals_;
  std::uint32_t count_ = 0;
};

}  // namespace

void add_surface_contacts(const RigidBody& body, std::uint32_t index, const SurfaceDistance& surface,
                          ContactSolver& solver) noexcept {
  if (body.settings().half.minCoeff() > 0) BoxContacts{body, index, surface, solver}.add();
}

}  // namespace tactus::haptics
