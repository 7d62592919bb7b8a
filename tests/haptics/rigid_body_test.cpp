#include "haptics/rigid_body.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "haptics/body_touch.hpp"
#include "tests/haptics/triangle_surface.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

const Vec3d kHalf{0.04, 0.03, 0.05};

/// One step of a body on the ground z = 0.
void step(RigidBody& body, ContactSolver& solver) {
  body.begin(kCycle);
  SolverBody moving = body.free_motion();
  solver.begin();
  add_ground_contacts(body, 0, 0, solver);
  (void)solver.solve({&moving, 1}, kCycle);
  body.finish(moving.velocity);
}

TEST(RigidBody, FallsWithGravity) {
  RigidBody body{box_body(0.3, kHalf)};
  for (int i = 0; i < 500; ++i) {
    body.begin(kCycle);
    body.finish(body.free_motion().velocity);
  }
  EXPECT_NEAR(body.state().velocity.z(), -9.81 * 0.5, 1e-12);
  EXPECT_NEAR(body.state().position.z(), -0.5 * 9.81 * 0.5 * (0.5 + kCycle), 1e-12);
}

TEST(RigidBody, AFreeRotationKeepsMomentumAndEnergy) {
  BodySettings settings = box_body(0.3, kHalf);
  settings.gravity.setZero();
  BodyState state;
  // The body rotates almost about its axis of intermediate inertia. This rotation is unstable.
  state.angular_velocity = {0.3, 12, 0.2};
  RigidBody body{settings, state};
  const Vec3d momentum = body.inertia_world() * state.angular_velocity;
  const double energy = body.kinetic_energy();
  double max_energy_error = 0;
  for (int i = 0; i < 20'000; ++i) {
    body.begin(kCycle);
    body.finish(body.free_motion().velocity);
    max_energy_error = std::max(max_energy_error, std::abs(body.kinetic_energy() / energy - 1));
  }
  EXPECT_LT((body.inertia_world() * body.state().angular_velocity - momentum).norm(), 1e-9 * momentum.norm());
  EXPECT_LT(max_energy_error, 0.01);
}

TEST(RigidBody, ASpringAddsNoEnergyAtAnyStiffness) {
  std::mt19937 random{7};
  std::uniform_real_distribution<double> uniform{-1, 1};
  const auto random_vector = [&](double size) {
    return Vec3d{size * uniform(random), size * uniform(random), size * uniform(random)};
  };
  for (const double stiffness : {1e2, 1e4, 1e6, 1e8}) {
    BodySettings settings = box_body(0.1, kHalf);
    settings.gravity.setZero();
    BodyState state;
    state.velocity = random_vector(0.5);
    RigidBody body{settings, state};
    const Vec3d target = random_vector(0.01);
    const auto energy = [&] {
      return body.kinetic_energy() + 0.5 * stiffness * (target - body.state().position).squaredNorm();
    };
    double last_energy = energy();
    for (int i = 0; i < 3000; ++i) {
      body.begin(kCycle);
      PointSpring spring;
      spring.point = body.state().position;
      spring.target = target;
      spring.stiffness = stiffness;
      body.add_spring(spring);
      body.finish(body.free_motion().velocity);
      ASSERT_LE(energy(), last_energy * (1 + 1e-12) + 1e-20) << stiffness << " N/m, step " << i;
      last_energy = energy();
    }
  }
}

TEST(RigidBody, LosesEnergyAndComesToRestWhenThrownOnTheGround) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    std::mt19937 random{seed};
    std::uniform_real_distribution<double> uniform{-1, 1};
    BodyState state;
    state.position = {0, 0, 0.2};
    state.velocity = {uniform(random), uniform(random), uniform(random)};
    state.angular_velocity = 10 * Vec3d{uniform(random), uniform(random), uniform(random)};
    state.orientation = exp_map(3 * Vec3d{uniform(random), uniform(random), uniform(random)});
    RigidBody body{box_body(0.3, kHalf), state};
    ContactSolver solver;
    double lowest_corner = 1, min_energy = body.kinetic_energy() + body.potential_energy();
    for (int i = 0; i < 3000; ++i) {
      step(body, solver);
      const double energy = body.kinetic_energy() + body.potential_energy();
      ASSERT_LE(energy, min_energy + 2e-4) << "seed " << seed << ", step " << i;
      min_energy = std::min(min_energy, energy);
      for (std::uint32_t k = 0; k < 8; ++k)
        lowest_corner = std::min(lowest_corner, body.state().to_world(body.settings().points[k]).z());
    }
    EXPECT_LT(body.top_speed(), 1e-4) << "seed " << seed;
    EXPECT_GT(lowest_corner, -5e-4) << "seed " << seed;
  }
}

TEST(RigidBody, SticksOrSlidesOnASlopeDependingOnItsFriction) {
  for (const double friction : {0.3, 0.6}) {
    BodySettings settings = box_body(0.3, {0.05, 0.05, 0.02});
    settings.friction = friction;
    const double slope = std::atan(0.45);
    settings.gravity = 9.81 * Vec3d{std::sin(slope), 0, -std::cos(slope)};
    BodyState state;
    state.position.z() = 0.02;
    RigidBody body{settings, state};
    ContactSolver solver;
    for (int i = 0; i < 1000; ++i) step(body, solver);
    const double expected = std::max(0.0, 9.81 * (std::sin(slope) - friction * std::cos(slope)));
    EXPECT_NEAR(body.state().velocity.x(), expected, 0.005 * 9.81) << friction;
  }
}

void step_on(RigidBody& body, ContactSolver& solver, const SurfaceDistance& surface) {
  body.begin(kCycle);
  SolverBody moving = body.free_motion();
  solver.begin();
  add_surface_contacts(body, 0, surface, solver);
  (void)solver.solve({&moving, 1}, kCycle);
  body.finish(moving.velocity);
}

TEST(RigidBody, RestsOnStaticGeometry) {
  const testing::TriangleSurface table{testing::square(0.3, 0.1)};
  BodyState state;
  state.position = {0.01, 0, 0.17};
  RigidBody body{box_body(0.3, kHalf), state};
  ContactSolver solver;
  for (int i = 0; i < 1000; ++i) step_on(body, solver, table);
  EXPECT_NEAR(body.state().position.z(), 0.15, 1e-4);
  EXPECT_LT(body.top_speed(), 1e-5);
}

/// A plane through the origin that falls towards +x at the angle `slope`, rad. The edges of its triangles are
/// millimetres to centimetres long.
testing::TriangleSurface tessellated_slope(double slope) {
  constexpr int kCells = 9;
  const auto grid_point = [&](int i, int j) -> Vec3d {
    const double distance = 0.4 * (std::pow(static_cast<double>(i) / kCells, 1.5) - 0.3);
    return {distance * std::cos(slope), 0.3 * (static_cast<double>(j) / kCells - 0.5), -distance * std::sin(slope)};
  };
  std::vector<testing::Triangle> triangles;
  for (int i = 0; i < kCells; ++i)
    for (int j = 0; j < kCells; ++j) {
      triangles.push_back({grid_point(i, j), grid_point(i + 1, j), grid_point(i + 1, j + 1)});
      triangles.push_back({grid_point(i, j), grid_point(i + 1, j + 1), grid_point(i, j + 1)});
    }
  return testing::TriangleSurface{std::move(triangles)};
}

TEST(RigidBody, SticksOrSlidesOnATessellatedSlopeDependingOnItsFriction) {
  for (const double friction : {0.3, 0.44, 0.46, 0.6}) {
    SCOPED_TRACE(friction);
    const double slope = std::atan(0.45);
    const testing::TriangleSurface surface = tessellated_slope(slope);
    BodySettings settings = box_body(0.3, {0.05, 0.03, 0.02});
    settings.friction = friction;
    BodyState state;
    state.orientation = Eigen::AngleAxisd{slope, Vec3d::UnitY()} * Eigen::AngleAxisd{0.3, Vec3d::UnitZ()};
    const Vec3d normal = Eigen::AngleAxisd{slope, Vec3d::UnitY()} * Vec3d::UnitZ();
    state.position = 0.0201 * normal;
    RigidBody body{settings, state};
    ContactSolver solver;
    for (int i = 0; i < 300; ++i) step_on(body, solver, surface);
    const Vec3d downhill{std::cos(slope), 0, -std::sin(slope)};
    const double expected = 0.3 * std::max(0.0, 9.81 * (std::sin(slope) - friction * std::cos(slope)));
    EXPECT_NEAR(body.state().velocity.dot(downhill), expected, 0.003 * 9.81);
    EXPECT_NEAR(body.state().position.dot(normal), 0.02, 1e-4);
    EXPECT_LT(body.state().angular_velocity.norm(), 0.02);
  }
}

TEST(RigidBody, IsSupportedByATipUnderTheMiddleOfAFace) {
  // The pyramid rises at 23 degrees. Its tip is not below a corner, an edge or a search start point of the box.
  const Vec3d tip{0.004, -0.007, 0.05};
  constexpr double kHalfBase = 0.12;
  std::array<Vec3d, 4> base;
  for (int i = 0; i < 4; ++i) base[i] = {i == 1 || i == 2 ? kHalfBase : -kHalfBase, i >= 2 ? kHalfBase : -kHalfBase, 0};
  std::vector<testing::Triangle> triangles;
  for (int i = 0; i < 4; ++i) triangles.push_back({base[i], base[(i + 1) % 4], tip});
  const testing::TriangleSurface pyramid{std::move(triangles)};
  BodySettings settings = box_body(0.3, {0.04, 0.03, 0.01});
  BodyState state;
  state.position = {0.0, 0.0, 0.0615};
  RigidBody body{settings, state};
  ContactSolver solver;
  for (int i = 0; i < 60; ++i)
    step_on(body, solver, pyramid);  // later the box falls over, because its centre is not above the tip
  EXPECT_GT(body.state().to_body(tip).z(), -0.0101);
  EXPECT_LT(body.state().to_body(tip).z(), -0.0099);
  EXPECT_GT(solver.last().contacts, 0u);
}

TEST(RigidBody, LogIsTheInverseOfExp) {
  std::mt19937 random{3};
  std::uniform_real_distribution<double> uniform{-1, 1};
  for (int i = 0; i < 200; ++i) {
    const Vec3d rotation = (i % 2 == 0 ? 1.7 : 1e-10) * Vec3d{uniform(random), uniform(random), uniform(random)};
    EXPECT_LT((log_map(exp_map(rotation)) - rotation).norm(), 1e-12);
  }
}

TEST(RigidBody, ARotationalSpringReachesItsTargetAndAddsNoEnergy) {
  BodySettings settings = box_body(0.3, kHalf);
  settings.gravity.setZero();
  for (const double stiffness : {2.5, 250.0, 25000.0}) {  // explicit integration is unstable at 25000 N m/rad
    SCOPED_TRACE(stiffness);
    BodyState start;
    start.orientation = exp_map({0.7, -0.4, 0.9});
    start.angular_velocity = {3, 5, -4};
    RigidBody body{settings, start};
    const auto energy = [&] {
      return body.kinetic_energy() + 0.5 * stiffness * log_map(body.state().orientation).squaredNorm();
    };
    double last_energy = energy();
    const double start_energy = last_energy;
    for (int i = 0; i < 5000; ++i) {
      body.begin(kCycle);
      body.add_spring(RotationalSpring{-log_map(body.state().orientation), Vec3d::Zero(), stiffness, 0.01 * stiffness});
      body.finish(body.free_motion().velocity);
      EXPECT_LE(energy(), last_energy + 1e-3 * start_energy) << i;
      last_energy = energy();
    }
    EXPECT_LT(log_map(body.state().orientation).norm(), 1e-6);
    EXPECT_LT(body.state().angular_velocity.norm(), 1e-5);
  }
}

/// A box on the ground, and two probes that press the box at given positions.
class PressedBox {
 public:
  explicit PressedBox(double mass, double friction) : body_{box_body(mass, kHalf), resting_state()} {
    for (BodyTouch& touch : touches_) touch.set_grip({friction, friction});
  }

  void step(const Vec3d& left, const Vec3d& right, bool grab = false) {
    const std::array<Vec3d, 2> positions{left, right};
    body_.begin(kCycle);
    for (std::size_t i = 0; i < 2; ++i) {
      DeviceState device;
      device.position = positions[i];
      touches_[i].step(device, grab, body_.state(), shape_, kFeel, kCycle);
      if (touches_[i].is_touching()) body_.add_spring(touches_[i].spring());
    }
    SolverBody moving = body_.free_motion();
    solver_.begin();
    add_ground_contacts(body_, 0, 0, solver_);
    (void)solver_.solve({&moving, 1}, kCycle);
    body_.finish(moving.velocity);
  }
  [[nodiscard]] const BodyState& state() const { return body_.state(); }
  [[nodiscard]] const BodyTouch& touch(std::size_t i) const { return touches_[i]; }

  static BodyState resting_state() {
    BodyState state;
    state.position.z() = kHalf.z();
    return state;
  }
  static constexpr ContactImpedance kFeel{1000, 2};

 private:
  RigidBody body_;
  BoxSurface shape_{kHalf};
  ContactSolver solver_;
  std::array<BodyTouch, 2> touches_;
};

/// Presses the box from both sides in x by `depth`, then moves the probes up by 0.1 m. Returns the final height of the
/// box above the ground.
double lifted_height(PressedBox& box, double depth) {
  const double contact_x = kHalf.x() + 0.003;
  for (int i = 0; i < 3000; ++i) {
    const double x = (contact_x + 0.005) - std::min(1.0, i / 500.0) * (0.005 + depth);
    const double height = kHalf.z() + 0.1 * std::clamp((i - 700) / 1000.0, 0.0, 1.0);
    box.step({-x, 0, height}, {x, 0, height});
  }
  return box.state().position.z() - kHalf.z();
}

TEST(BodyTouch, TwoProbesLiftABoxOnlyIfTheirFrictionCarriesItsWeight) {
  // Each probe presses with 3 N. The weight is 2.9 N; friction carries 4.8 N with a coefficient of 0.8, 1.8 N with 0.3.
  PressedBox rough{0.3, 0.8}, slippery{0.3, 0.3};
  EXPECT_NEAR(lifted_height(rough, 0.003), 0.1, 0.004);
  EXPECT_LT(lifted_height(slippery, 0.003), 0.01);
}

TEST(BodyTouch, OneProbePushesABoxButDoesNotPullIt) {
  PressedBox box{0.1, 0.1};
  const Vec3d no_contact{1, 0, kHalf.z()};
  double x = -(kHalf.x() + 0.004);
  for (int i = 0; i < 1000; ++i) box.step({x += 5e-5, 0, kHalf.z()}, no_contact);
  const double x_after_push = box.state().position.x();
  EXPECT_GT(x_after_push, 0.04);
  for (int i = 0; i < 1000; ++i) box.step({x -= 5e-5, 0, kHalf.z()}, no_contact);
  EXPECT_NEAR(box.state().position.x(), x_after_push, 0.005);
  EXPECT_FALSE(box.touch(0).is_touching());
}

TEST(BodyTouch, AGrabPullsABoxUntilTheRelease) {
  PressedBox box{0.1, 0.1};
  const Vec3d no_contact{1, 0, kHalf.z()};
  double x = -(kHalf.x() + 0.0025);  // a depth of 0.5 mm
  box.step({x - 0.001, 0, kHalf.z()}, no_contact);
  for (int i = 0; i < 1000; ++i) box.step({x -= 5e-5, 0, kHalf.z()}, no_contact, true);
  EXPECT_TRUE(box.touch(0).is_holding());
  EXPECT_NEAR(box.state().position.x(), -0.05, 0.005);
  box.step({x, 0, kHalf.z()}, no_contact);
  EXPECT_FALSE(box.touch(0).is_holding());
}

}  // namespace
}  // namespace tactus::haptics
