#include "haptics/tool.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <utility>

#include "haptics/rigid_body.hpp"
#include "spm/offline/generate.hpp"
#include "tests/haptics/tool_shapes.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

using namespace testing;
using test_support::ShownMesh;

constexpr double kHalfEdge = 0.01;  // of the cube, m
const double kCollisionMargin = ToolSettings{}.collision_margin;

spm::MeshProbe probe_of(const TriangleMesh& mesh) { return spm::MeshProbe{mesh.positions, mesh.faces}; }
TriangleMesh cube() { return box_mesh(Vec3d::Constant(-kHalfEdge), Vec3d::Constant(kHalfEdge)); }
ToolPose pose_at(double x, double y, double z, const Vec3d& rotation = Vec3d::Zero()) {
  return {{x, y, z}, exp_map(rotation)};
}

/// A tool and an object, both meshes in metres.
struct Scene {
  Scene(const TriangleMesh& tool_shape, const TriangleMesh& object_shape, double friction = 0,
        const ToolSettings& settings = {})
      : tool_mesh{tool_shape},
        object_mesh{object_shape},
        probe{probe_of(tool_shape)},
        shown{object_shape},
        tool{probe, settings},
        object{object_of(shown, friction)} {}
  const ToolResult& step(const ToolPose& device) {
    return tool.step(device, kCycle, {&object, 1}, std::exchange(changed, false));
  }
  const ToolResult& hold(const ToolPose& device, int cycles) {
    for (int i = 0; i < cycles; ++i) step(device);
    return tool.last();
  }
  /// Moves the device on a straight line at constant speed.
  const ToolResult& move(const ToolPose& from, const ToolPose& to, int cycles) {
    for (int i = 1; i <= cycles; ++i) {
      const double share = static_cast<double>(i) / cycles;
      step({from.position + share * (to.position - from.position), from.orientation.slerp(share, to.orientation)});
    }
    return tool.last();
  }
  [[nodiscard]] std::size_t intersections() const {
    return count_intersections(object_mesh, tool_mesh, tool.last().pose);
  }

  TriangleMesh tool_mesh, object_mesh;
  spm::MeshProbe probe;
  ShownMesh shown;
  Tool tool;
  ToolObject object;
  bool changed = true;  // the shown mesh changed since the last step
};

TEST(Tool, FollowsTheDeviceInTheAir) {
  Scene scene{cube(), sheet(0.1, 0)};
  for (int i = 0; i < 100; ++i) {
    const ToolPose device = pose_at(0.0005 * i, 0, 0.03 + 0.0002 * i, {0.02 * i, std::sin(0.05 * i), -0.01 * i});
    const ToolResult& result = scene.step(device);
    EXPECT_LT(result.displacement.norm(), 1e-15);
    EXPECT_LT(result.rotation.norm(), 1e-12);
    EXPECT_FALSE(result.in_contact);
    EXPECT_FALSE(result.lagging);
  }
}

TEST(Tool, ABoxRestsOnAPlaneAtItsCollisionMargin) {
  Scene scene{cube(), sheet(0.1, 0, 7)};
  scene.move(pose_at(0, 0, 0.015), pose_at(0.002, 0.001, 0.005), 100);
  const ToolResult& result = scene.hold(pose_at(0.002, 0.001, 0.005), 50);
  EXPECT_TRUE(result.in_contact);
  EXPECT_NEAR(result.pose.position.z(), kHalfEdge + kCollisionMargin, 0.15 * kCollisionMargin);
  EXPECT_NEAR(result.displacement.x(), 0, 1e-6);
  EXPECT_NEAR(result.displacement.y(), 0, 1e-6);
  EXPECT_LT(result.rotation.norm(), 1e-4);
  EXPECT_GT(result.normal.z(), 1 - 1e-6);
  EXPECT_EQ(scene.intersections(), 0u);
}

TEST(Tool, ABoxTiltsUntilSpringAndRotationalSpringBalance) {
  Scene scene{cube(), sheet(0.1, 0, 5)};
  ToolGrip grip;
  scene.tool.set_grip(grip);
  const double tilt = 0.4, height = 0.008;
  const ToolPose device = pose_at(0, 0, height, {tilt, 0, 0});
  scene.move(pose_at(0, 0, 0.03, {tilt, 0, 0}), device, 100);
  const ToolResult& result = scene.hold(device, 200);
  // Searches the angle of minimum energy among all poses with the lowest edge of the tool at the
  // collision margin above the plane.
  double min_energy = 1e9, expected = 0;
  for (double angle = 0; angle < tilt; angle += 1e-5) {
    const double z = kHalfEdge * (std::cos(angle) + std::sin(angle)) + kCollisionMargin;
    const double energy =
        grip.stiffness * std::pow(z - height, 2) + grip.rotational_stiffness * std::pow(tilt - angle, 2);
    if (energy < min_energy) {
      min_energy = energy;
      expected = angle;
    }
  }
  EXPECT_NEAR(log_map(result.pose.orientation).x(), expected, 2e-3);
  EXPECT_NEAR(result.rotation.x(), expected - tilt, 2e-3);
  EXPECT_EQ(scene.intersections(), 0u);
}

TEST(Tool, APegEntersAHoleWithAClearanceOfAQuarterMillimetre) {
  // The walls of a square hole; the clearance is 0.25 mm on each side.
  TriangleMesh hole;
  const double inner = 0.00525, outer = 0.03, bottom = -0.03;
  add_box(hole, {-outer, -outer, bottom}, {-inner, outer, 0});
  add_box(hole, {inner, -outer, bottom}, {outer, outer, 0});
  add_box(hole, {-inner, -outer, bottom}, {inner, -inner, 0});
  add_box(hole, {-inner, inner, bottom}, {inner, outer, 0});
  Scene scene{box_mesh({-0.005, -0.005, -0.02}, {0.005, 0.005, 0.02}), hole};
  // The device is 1 mm off the axis of the hole in x and in y, and tilted.
  const Vec3d tilt{0.03, -0.02, 0.05};
  scene.move(pose_at(0, 0, 0.025), pose_at(0, 0, 0.015), 100);
  scene.move(pose_at(0, 0, 0.015), pose_at(0.001, -0.001, -0.002, tilt), 400);
  const ToolResult& result = scene.hold(pose_at(0.001, -0.001, -0.002, tilt), 100);
  EXPECT_LT(result.pose.position.z(), 0);
  EXPECT_LT(std::abs(result.pose.position.x()), 0.0006);
  EXPECT_LT(log_map(result.pose.orientation).norm(), 0.08);
  EXPECT_GT(result.contacts, 1u);
  EXPECT_EQ(scene.intersections(), 0u);
}

TEST(Tool, AnEdgeInAGrooveRestsOnBothSides) {
  TriangleMesh groove;  // along y; opens upwards at a right angle
  add_quad(groove, {0, -0.05, 0}, {0, 0.05, 0}, {-0.05, 0.05, 0.05}, {-0.05, -0.05, 0.05});
  add_quad(groove, {0, 0.05, 0}, {0, -0.05, 0}, {0.05, -0.05, 0.05}, {0.05, 0.05, 0.05});
  Scene scene{cube(), groove};
  const Vec3d diagonal{0, 3.14159265358979323846 / 4, 0};
  scene.move(pose_at(0, 0, 0.03, diagonal), pose_at(0.002, 0.003, 0.005, diagonal), 200);
  const ToolResult& result = scene.hold(pose_at(0.002, 0.003, 0.005, diagonal), 100);
  const double expected_z = std::sqrt(2) * (kHalfEdge + kCollisionMargin);  // the centre above the bottom edge
  EXPECT_NEAR(result.pose.position.x(), 0, 0.3 * kCollisionMargin);
  EXPECT_NEAR(result.pose.position.y(), 0.003, 1e-5);
  EXPECT_NEAR(result.pose.position.z(), expected_z, 0.3 * kCollisionMargin);
  EXPECT_EQ(scene.intersections(), 0u);
}

TEST(Tool, SticksInsideTheFrictionConeAndSlidesOnItsRim) {
  constexpr double kFriction = 0.4;
  Scene scene{cube(), sheet(0.1, 0, 5), kFriction};
  scene.move(pose_at(0, 0, 0.015), pose_at(0, 0, 0.005), 100);
  const double depth = scene.hold(pose_at(0, 0, 0.005), 20).displacement.z();
  const double x_before = scene.tool.last().pose.position.x();
  scene.move(pose_at(0, 0, 0.005), pose_at(0.8 * kFriction * depth, 0, 0.005), 50);
  EXPECT_NEAR(scene.tool.last().pose.position.x(), x_before, 2e-5);
  const ToolResult& result = scene.move(pose_at(0.8 * kFriction * depth, 0, 0.005), pose_at(0.02, 0, 0.005), 200);
  EXPECT_GT(result.pose.position.x(), x_before + 0.01);
  EXPECT_NEAR(-result.displacement.x() / result.displacement.z(), kFriction, 0.05 * kFriction);
}

TEST(Tool, NoJumpOfTheDeviceMovesTheToolThroughASheet) {
  for (const int parts : {1, 4}) {
    Scene scene{spm::offline::stylus(), sheet(0.1, 0, parts)};
    scene.step(pose_at(0, 0, 0.004));
    std::mt19937_64 random{3};
    std::uniform_real_distribution<double> uniform{-1, 1};
    for (int i = 0; i < 800; ++i) {
      if (i % 100 == 50) scene.hold(pose_at(0, 0, 0.05), 60);  // returns above the sheet
      const Vec3d rotation = 1.5 * Vec3d{uniform(random), uniform(random), uniform(random)};
      scene.step(pose_at(0.02 * uniform(random), 0.02 * uniform(random), -0.05, rotation));
      if (i % 8 == 0) {
        ASSERT_EQ(scene.intersections(), 0u) << i;
      }
      for (const auto& p : scene.tool_mesh.positions)
        ASSERT_GT((scene.tool.last().pose.position + scene.tool.last().pose.orientation * Vec3d{p[0], p[1], p[2]}).z(),
                  0)
            << i;
    }
  }
}

TEST(Tool, StaysInAClosedBoxForAnyDeviceMotion) {
  const double half_box = 0.025;
  Scene scene{box_mesh({-0.002, -0.004, -0.01}, {0.003, 0.004, 0.012}),
              box_mesh(Vec3d::Constant(-half_box), Vec3d::Constant(half_box), true)};
  scene.step(pose_at(0, 0, 0));
  std::mt19937_64 random{4};
  std::normal_distribution<double> normal;
  ToolPose device = pose_at(0, 0, 0);
  int contacts = 0;
  for (int i = 0; i < 4000; ++i) {
    if (i % 20 == 0) {
      device.position = 0.04 * Vec3d{normal(random), normal(random), normal(random)};
      device.orientation =
          Eigen::Quaterniond{normal(random), normal(random), normal(random), normal(random)}.normalized();
    }
    const ToolResult& result = scene.step(device);
    contacts += result.in_contact ? 1 : 0;
    ASSERT_EQ(scene.intersections(), 0u) << i;
    ASSERT_LT(result.pose.position.cwiseAbs().maxCoeff(), half_box) << i;
  }
  EXPECT_GT(contacts, 1000);
}

TEST(Tool, NeverOverlapsABumpyBodyInRandomMotionsEvenWithASmallBudget) {
  const TriangleMesh organ = spm::offline::generate(spm::offline::Shape::kOrgan, 6000);
  for (const std::uint32_t work : {ToolSettings{}.work, 700u}) {
    ToolSettings settings;
    settings.work = work;
    Scene scene{spm::offline::stylus(), organ, 0.3, settings};
    std::mt19937_64 random{5};
    std::normal_distribution<double> normal;
    ToolPose device = pose_at(0, 0, 0.15);
    scene.step(device);
    ToolPose goal = device;
    int contacts = 0, lagging = 0;
    for (int i = 0; i < 3000; ++i) {
      if (i % 150 == 0) {
        goal.position = 0.04 * Vec3d{normal(random), normal(random), normal(random)};
        goal.orientation =
            Eigen::Quaterniond{normal(random), normal(random), normal(random), normal(random)}.normalized();
      }
      const Vec3d to_goal = goal.position - device.position;
      device.position += to_goal * std::min(1.0, 0.0006 / std::max(to_goal.norm(), 1e-9));
      device.orientation = device.orientation.slerp(0.01, goal.orientation);
      const ToolResult& result = scene.step(device);
      contacts += result.in_contact ? 1 : 0;
      lagging += result.lagging ? 1 : 0;
      if (i % 60 == 0) {
        ASSERT_EQ(scene.intersections(), 0u) << i << " work " << work;
      }
      ASSERT_LE(result.work, work + 1500);
    }
    EXPECT_GT(contacts, 500);
    if (work < 1000) {
      EXPECT_GT(lagging, 100);
    }
  }
}

TEST(Tool, IsPushedOutWithoutAJumpWhenASurfaceRisesUnderIt) {
  TriangleMesh two_sheets = sheet(0.05, 0, 4);
  const double rise = 0.0003;
  const TriangleMesh upper = sheet(0.05, rise, 4);
  for (const auto& p : upper.positions) two_sheets.positions.push_back(p);
  for (const auto& f : upper.faces)
    two_sheets.faces.push_back({f[0] + static_cast<std::uint32_t>(upper.positions.size()),
                                f[1] + static_cast<std::uint32_t>(upper.positions.size()),
                                f[2] + static_cast<std::uint32_t>(upper.positions.size())});
  Scene scene{cube(), two_sheets};
  const auto lies_in_upper_sheet = [&](std::uint32_t face) {
    for (const spm::LeafLane at : scene.shown.tree().shown())
      if (index(scene.shown.tree().face(at)) == face) return scene.shown.triangle(at)[0].z() > rise / 2;
    return false;
  };
  std::vector<bool> upper_faces;
  for (std::uint32_t f = 0; f < two_sheets.faces.size(); ++f) upper_faces.push_back(lies_in_upper_sheet(f));
  scene.shown.show([&](std::uint32_t f) { return !upper_faces[f]; });
  scene.changed = true;
  scene.move(pose_at(0, 0, 0.012), pose_at(0, 0, 0.008), 100);
  scene.hold(pose_at(0, 0, 0.008), 20);
  scene.shown.show([&](std::uint32_t f) { return upper_faces[f]; });
  scene.changed = true;
  double last_z = scene.tool.last().pose.position.z(), max_step = 0;
  bool reported = false;
  for (int i = 0; i < 100; ++i) {
    const ToolResult& result = scene.step(pose_at(0, 0, 0.008));
    reported = reported || result.too_near;
    max_step = std::max(max_step, result.pose.position.z() - last_z);
    EXPECT_GE(result.pose.position.z() - last_z, -1e-6);
    last_z = result.pose.position.z();
  }
  EXPECT_TRUE(reported);
  EXPECT_LT(max_step, 1.05 * ToolSettings{}.push_out * kCycle);
  EXPECT_NEAR(last_z, kHalfEdge + rise + kCollisionMargin, 0.3 * kCollisionMargin);
}

/// Over a slow link, refinement may raise the surface through a tool that is pressed against it.
TEST(Tool, LeavesASurfaceThatHasRisenDeepIntoIt) {
  for (const double rise : {0.001, 0.002, 0.004, 0.008}) {
    for (const double tilt : {0.0, 0.5, 1.0}) {
      SCOPED_TRACE(std::to_string(rise) + " m, tilted by " + std::to_string(tilt));
      Scene scene{spm::offline::stylus(), sheet(0.04, 0, 160)};
      const Vec3d rotation{tilt, 0, 0.3};
      scene.hold(pose_at(0, 0, 0.006, rotation), 1);
      scene.move(pose_at(0, 0, 0.006, rotation), pose_at(0, 0, 0.001, rotation), 50);
      scene.object.translation.z() = rise;
      scene.changed = true;
      double last_z = scene.tool.last().pose.position.z(), max_step = 0;
      for (int i = 0; i < 1000; ++i) {
        const double z = scene.step(pose_at(0, 0, 0.001, rotation)).pose.position.z();
        max_step = std::max(max_step, z - last_z);
        last_z = z;
      }
      ToolPose pose = scene.tool.last().pose;
      pose.position.z() -= rise;
      EXPECT_EQ(count_intersections(scene.object_mesh, scene.tool_mesh, pose), 0u) << last_z;
      // The normal is tilted and the tool also slides, so the vertical speed may exceed push_out.
      EXPECT_LT(max_step, 1.25 * ToolSettings{}.push_out * kCycle);
      EXPECT_FALSE(scene.tool.last().outside_only);
      // Afterwards the tool follows the device without contact.
      EXPECT_LT(scene.move(pose_at(0, 0, 0.001, rotation), pose_at(0, 0, 0.03, rotation), 300).displacement.norm(),
                1e-9);
    }
  }
}

TEST(Tool, TheForceFallsWithinItsRateLimitWhenTheSurfaceDisappears) {
  Scene scene{cube(), sheet(0.1, 0, 3)};
  ToolGrip grip;
  grip.stiffness = 2000;
  scene.tool.set_grip(grip);
  scene.move(pose_at(0, 0, 0.015), pose_at(0, 0, 0.008), 100);
  double last_force = grip.stiffness * scene.tool.last().displacement.norm(), max_fall = 0;
  ASSERT_GT(last_force, 4);
  scene.shown.show([](std::uint32_t) { return false; });
  scene.changed = true;
  int cycles = 0;
  for (; last_force > 1e-6 && cycles < 1000; ++cycles) {
    const double force = grip.stiffness * scene.step(pose_at(0, 0, 0.008)).displacement.norm();
    max_fall = std::max(max_fall, last_force - force);
    last_force = force;
  }
  const double allowed_fall = ToolSettings{}.max_yield * kCycle;
  EXPECT_LT(max_fall, 1.01 * allowed_fall);
  EXPECT_LT(cycles, 1.3 * 4.2 / allowed_fall);
}

TEST(Tool, StartedInASurfaceTouchesNothingUntilItIsOutside) {
  Scene scene{cube(), sheet(0.1, 0, 3)};
  EXPECT_TRUE(scene.step(pose_at(0, 0, 0.005)).outside_only);
  EXPECT_EQ(scene.tool.last().displacement.norm(), 0);
  EXPECT_TRUE(scene.hold(pose_at(0, 0, 0.0), 10).outside_only);
  EXPECT_FALSE(scene.step(pose_at(0, 0, 0.011)).outside_only);
  EXPECT_GT(scene.move(pose_at(0, 0, 0.011), pose_at(0, 0, 0.005), 50).displacement.z(), 0.004);
}

TEST(Tool, InputThatIsNotFiniteChangesNothing) {
  Scene scene{cube(), sheet(0.1, 0, 3)};
  scene.move(pose_at(0, 0, 0.02), pose_at(0, 0, 0.005), 50);
  const ToolResult before = scene.tool.last();
  for (ToolPose device : {pose_at(NAN, 0, 0), pose_at(0, INFINITY, 0), pose_at(0, 0, 0.005)}) {
    if (device.position.allFinite()) device.orientation.coeffs().setConstant(NAN);
    scene.step(device);
    EXPECT_EQ(scene.tool.last().pose.position, before.pose.position);
    EXPECT_EQ(scene.tool.last().displacement, before.displacement);
  }
}

TEST(Tool, RepeatsBitForBit) {
  const TriangleMesh organ = spm::offline::generate(spm::offline::Shape::kOrgan, 6000);
  std::vector<double> first_run;
  for (int run = 0; run < 2; ++run) {
    Scene scene{spm::offline::stylus(), organ, 0.3};
    scene.step(pose_at(0, 0, 0.1));
    std::size_t next_value = 0;
    for (int ms = 0; ms < 600; ++ms) {
      const double t = ms * kCycle;
      const ToolResult& result =
          scene.step(pose_at(0.01 * std::sin(9 * t), 0, 0.1 - 0.15 * t, {3 * t, std::sin(7 * t), t}));
      for (const double number : {result.displacement[0], result.displacement[1], result.displacement[2],
                                  result.rotation[0], result.rotation[1]}) {
        if (run == 0)
          first_run.push_back(number);
        else
          ASSERT_EQ(std::memcmp(&number, &first_run[next_value++], sizeof number), 0) << ms;
      }
    }
    EXPECT_TRUE(scene.tool.last().in_contact);
  }
}

}  // namespace
}  // namespace tactus::haptics
