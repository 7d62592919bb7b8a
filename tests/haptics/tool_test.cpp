#include "haptics/tool.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <utility>

#include "haptics/rigid_body.hpp"
#include "spm/offline/generate.hpp"
#include "tests/haptics/tool_shapes.hpp"

namespace tactus::haptics {
namespace {

using namespace testing;
using test_support::ShownMesh;

constexpr double kCycle = 1e-3;
constexpr double kHalf = 0.01;  // of the box, m
const double kCollisionMargin = ToolSettings{}.collision_margin;

spm::MeshProbe probe_of(const TriangleMesh& mesh) { return spm::MeshProbe{mesh.positions, mesh.faces}; }
TriangleMesh cube() { return box_mesh(Vec3d::Constant(-kHalf), Vec3d::Constant(kHalf)); }
ToolPose at(double x, double y, double z, const Vec3d& rotation = Vec3d::Zero()) {
  return {{x, y, z}, exp_map(rotation)};
}

/// A tool and objects, each a mesh in metres.
struct Scene {
  Scene(const TriangleMesh& tool_mesh, const TriangleMesh& mesh, double friction = 0, const ToolSettings& settings = {})
      : tool_shape{tool_mesh},
        shape{mesh},
        probe{probe_of(tool_mesh)},
        shown{mesh},
        tool{probe, settings},
        object{object_of(shown, friction)} {}
  const ToolResult& step(const ToolPose& device) {
    const bool now = std::exchange(changed, false);
    return tool.step(device, kCycle, {&object, 1}, now);
  }
  const ToolResult& hold(const ToolPose& device, int cycles) {
    for (int i = 0; i < cycles; ++i) step(device);
    return tool.last();
  }
  /// Straight and at constant speed.
  const ToolResult& lead(const ToolPose& from, const ToolPose& to, int cycles) {
    for (int i = 1; i <= cycles; ++i) {
      const double part = static_cast<double>(i) / cycles;
      step({from.position + part * (to.position - from.position), from.orientation.slerp(part, to.orientation)});
    }
    return tool.last();
  }
  [[nodiscard]] std::size_t meets() const { return meeting(shape, tool_shape, tool.last().pose); }

  TriangleMesh tool_shape, shape;
  spm::MeshProbe probe;
  ShownMesh shown;
  Tool tool;
  ToolObject object;
  bool changed = true;  // the shown mesh changed since the last step
};

TEST(Tool, FollowsTheDeviceToTheBitInTheAir) {
  Scene scene{cube(), sheet(0.1, 0)};
  for (int i = 0; i < 100; ++i) {
    const ToolPose device = at(0.0005 * i, 0, 0.03 + 0.0002 * i, {0.02 * i, std::sin(0.05 * i), -0.01 * i});
    const ToolResult& result = scene.step(device);
    EXPECT_LT(result.displacement.norm(), 1e-15);
    EXPECT_LT(result.rotation.norm(), 1e-12);
    EXPECT_FALSE(result.in_contact);
    EXPECT_FALSE(result.lagging);
  }
}

TEST(Tool, BoxRestsOnAPlaneAtItsCollisionMargin) {
  Scene scene{cube(), sheet(0.1, 0, 7)};
  scene.lead(at(0, 0, 0.015), at(0.002, 0.001, 0.005), 100);
  const ToolResult& result = scene.hold(at(0.002, 0.001, 0.005), 50);
  EXPECT_TRUE(result.in_contact);
  EXPECT_NEAR(result.pose.position.z(), kHalf + kCollisionMargin, 0.15 * kCollisionMargin);
  EXPECT_NEAR(result.displacement.x(), 0, 1e-6);
  EXPECT_NEAR(result.displacement.y(), 0, 1e-6);
  EXPECT_LT(result.rotation.norm(), 1e-4);
  EXPECT_GT(result.normal.z(), 1 - 1e-6);
  EXPECT_EQ(scene.meets(), 0u);
}

TEST(Tool, BoxTiltsUntilSpringAndRotationalSpringBalance) {
  Scene scene{cube(), sheet(0.1, 0, 5)};
  ToolGrip grip;
  scene.tool.set_grip(grip);
  const double lean = 0.4, height = 0.008;
  const ToolPose device = at(0, 0, height, {lean, 0, 0});
  scene.lead(at(0, 0, 0.03, {lean, 0, 0}), device, 100);
  const ToolResult& result = scene.hold(device, 200);
  // The minimum energy over all tilts of the tool with its lowest edge on the plane.
  double best = 1e9, expected = 0;
  for (double angle = 0; angle < lean; angle += 1e-5) {
    const double z = kHalf * (std::cos(angle) + std::sin(angle)) + kCollisionMargin;
    const double energy =
        grip.stiffness * std::pow(z - height, 2) + grip.rotational_stiffness * std::pow(lean - angle, 2);
    if (energy < best) {
      best = energy;
      expected = angle;
    }
  }
  EXPECT_NEAR(log_map(result.pose.orientation).x(), expected, 2e-3);
  EXPECT_NEAR(result.rotation.x(), expected - lean, 2e-3);
  EXPECT_EQ(scene.meets(), 0u);
}

TEST(Tool, PegGoesDownAHoleWithHalfAMillimetreToSpare) {
  // Walls of a square shaft with a rim; clearance 0.25 mm on each side.
  TriangleMesh hole;
  const double in = 0.00525, out = 0.03, deep = -0.03;
  add_box(hole, {-out, -out, deep}, {-in, out, 0});
  add_box(hole, {in, -out, deep}, {out, out, 0});
  add_box(hole, {-in, -out, deep}, {in, -in, 0});
  add_box(hole, {-in, in, deep}, {in, out, 0});
  Scene scene{box_mesh({-0.005, -0.005, -0.02}, {0.005, 0.005, 0.02}), hole};
  // The hand is off by a millimetre and tilted.
  const Vec3d lean{0.03, -0.02, 0.05};
  scene.lead(at(0, 0, 0.025), at(0, 0, 0.015), 100);
  scene.lead(at(0, 0, 0.015), at(0.001, -0.001, -0.002, lean), 400);
  const ToolResult& result = scene.hold(at(0.001, -0.001, -0.002, lean), 100);
  EXPECT_LT(result.pose.position.z(), 0);
  EXPECT_LT(std::abs(result.pose.position.x()), 0.0006);
  EXPECT_LT(log_map(result.pose.orientation).norm(), 0.08);
  EXPECT_GT(result.contacts, 1u);
  EXPECT_EQ(scene.meets(), 0u);
}

TEST(Tool, EdgeInAWedgeIsHeldByBothSides) {
  TriangleMesh wedge;  // opens upwards at a right angle, along y
  add_quad(wedge, {0, -0.05, 0}, {0, 0.05, 0}, {-0.05, 0.05, 0.05}, {-0.05, -0.05, 0.05});
  add_quad(wedge, {0, 0.05, 0}, {0, -0.05, 0}, {0.05, -0.05, 0.05}, {0.05, 0.05, 0.05});
  Scene scene{cube(), wedge};
  const Vec3d diagonal{0, 3.14159265358979323846 / 4, 0};
  scene.lead(at(0, 0, 0.03, diagonal), at(0.002, 0.003, 0.005, diagonal), 200);
  const ToolResult& result = scene.hold(at(0.002, 0.003, 0.005, diagonal), 100);
  const double rest = std::sqrt(2) * (kHalf + kCollisionMargin);  // height of the centre above the groove
  EXPECT_NEAR(result.pose.position.x(), 0, 0.3 * kCollisionMargin);
  EXPECT_NEAR(result.pose.position.y(), 0.003, 1e-5);
  EXPECT_NEAR(result.pose.position.z(), rest, 0.3 * kCollisionMargin);
  EXPECT_EQ(scene.meets(), 0u);
}

TEST(Tool, FrictionHoldsWithinItsConeAndSlidesOnItsRim) {
  constexpr double kFriction = 0.4;
  Scene scene{cube(), sheet(0.1, 0, 5), kFriction};
  scene.lead(at(0, 0, 0.015), at(0, 0, 0.005), 100);
  const double pressed = scene.hold(at(0, 0, 0.005), 20).displacement.z();
  const double before = scene.tool.last().pose.position.x();
  scene.lead(at(0, 0, 0.005), at(0.8 * kFriction * pressed, 0, 0.005), 50);
  EXPECT_NEAR(scene.tool.last().pose.position.x(), before, 2e-5);
  const ToolResult& result = scene.lead(at(0.8 * kFriction * pressed, 0, 0.005), at(0.02, 0, 0.005), 200);
  EXPECT_GT(result.pose.position.x(), before + 0.01);
  EXPECT_NEAR(-result.displacement.x() / result.displacement.z(), kFriction, 0.05 * kFriction);
}

TEST(Tool, NoJumpOfTheDeviceCarriesItThroughASheet) {
  for (const int parts : {1, 4}) {
    Scene scene{spm::offline::stylus(), sheet(0.1, 0, parts)};
    scene.step(at(0, 0, 0.004));
    std::mt19937_64 random{3};
    std::uniform_real_distribution<double> along{-1, 1};
    for (int i = 0; i < 800; ++i) {
      if (i % 100 == 50) scene.hold(at(0, 0, 0.05), 60);  // up again
      const Vec3d rotation = 1.5 * Vec3d{along(random), along(random), along(random)};
      scene.step(at(0.02 * along(random), 0.02 * along(random), -0.05, rotation));
      if (i % 8 == 0) {
        ASSERT_EQ(scene.meets(), 0u) << i;
      }
      for (const auto& p : scene.tool_shape.positions)
        ASSERT_GT((scene.tool.last().pose.position + scene.tool.last().pose.orientation * Vec3d{p[0], p[1], p[2]}).z(),
                  0)
            << i;
    }
  }
}

TEST(Tool, StaysInAClosedBoxForAnyDeviceMotion) {
  const double room = 0.025;
  Scene scene{box_mesh({-0.002, -0.004, -0.01}, {0.003, 0.004, 0.012}),
              box_mesh(Vec3d::Constant(-room), Vec3d::Constant(room), true)};
  scene.step(at(0, 0, 0));
  std::mt19937_64 random{4};
  std::normal_distribution<double> normal;
  ToolPose device = at(0, 0, 0);
  int contacts = 0;
  for (int i = 0; i < 4000; ++i) {
    if (i % 20 == 0) {
      device.position = 0.04 * Vec3d{normal(random), normal(random), normal(random)};
      device.orientation =
          Eigen::Quaterniond{normal(random), normal(random), normal(random), normal(random)}.normalized();
    }
    const ToolResult& result = scene.step(device);
    contacts += result.in_contact ? 1 : 0;
    ASSERT_EQ(scene.meets(), 0u) << i;
    ASSERT_LT(result.pose.position.cwiseAbs().maxCoeff(), room) << i;
  }
  EXPECT_GT(contacts, 1000);
}

TEST(Tool, RandomMotionsNeverOverlapABumpyBodyEvenWithASmallBudget) {
  const TriangleMesh organ = spm::offline::generate(spm::offline::Shape::kOrgan, 6000);
  for (const std::uint32_t work : {ToolSettings{}.work, 700u}) {
    ToolSettings settings;
    settings.work = work;
    Scene scene{spm::offline::stylus(), organ, 0.3, settings};
    std::mt19937_64 random{5};
    std::normal_distribution<double> normal;
    ToolPose device = at(0, 0, 0.15);
    scene.step(device);
    ToolPose goal = device;
    int contacts = 0, lagging = 0;
    for (int i = 0; i < 3000; ++i) {
      if (i % 150 == 0) {
        goal.position = 0.04 * Vec3d{normal(random), normal(random), normal(random)};
        goal.orientation =
            Eigen::Quaterniond{normal(random), normal(random), normal(random), normal(random)}.normalized();
      }
      const Vec3d left = goal.position - device.position;
      device.position += left * std::min(1.0, 0.0006 / std::max(left.norm(), 1e-9));
      device.orientation = device.orientation.slerp(0.01, goal.orientation);
      const ToolResult& result = scene.step(device);
      contacts += result.in_contact ? 1 : 0;
      lagging += result.lagging ? 1 : 0;
      if (i % 60 == 0) {
        ASSERT_EQ(scene.meets(), 0u) << i << " work " << work;
      }
      ASSERT_LE(result.work, work + 1500);
    }
    EXPECT_GT(contacts, 500);
    if (work < 1000) {
      EXPECT_GT(lagging, 100);
    }
  }
}

TEST(Tool, IsPushedOutWhereASurfaceRisesUnderItWithoutAJump) {
  TriangleMesh both = sheet(0.05, 0, 4);
  const std::size_t lower = both.faces.size();
  const double rise = 0.0003;
  const TriangleMesh upper = sheet(0.05, rise, 4);
  for (const auto& p : upper.positions) both.positions.push_back(p);
  for (const auto& f : upper.faces)
    both.faces.push_back({f[0] + static_cast<std::uint32_t>(upper.positions.size()),
                          f[1] + static_cast<std::uint32_t>(upper.positions.size()),
                          f[2] + static_cast<std::uint32_t>(upper.positions.size())});
  static_cast<void>(lower);
  Scene scene{cube(), both};
  const auto is_upper = [&](std::uint32_t face) {
    for (const spm::RowIndex row : scene.shown.tree().shown())
      if (index(scene.shown.tree().row(row).face) == face) return scene.shown.triangle(row)[0].z() > rise / 2;
    return false;
  };
  std::vector<bool> high;
  for (std::uint32_t f = 0; f < both.faces.size(); ++f) high.push_back(is_upper(f));
  scene.shown.show([&](std::uint32_t f) { return !high[f]; });
  scene.changed = true;
  scene.lead(at(0, 0, 0.012), at(0, 0, 0.008), 100);
  scene.hold(at(0, 0, 0.008), 20);
  scene.shown.show([&](std::uint32_t f) { return high[f]; });
  scene.changed = true;
  double before = scene.tool.last().pose.position.z(), highest = 0;
  bool reported = false;
  for (int i = 0; i < 100; ++i) {
    const ToolResult& result = scene.step(at(0, 0, 0.008));
    reported = reported || result.too_near;
    highest = std::max(highest, result.pose.position.z() - before);
    EXPECT_GE(result.pose.position.z() - before, -1e-6);
    before = result.pose.position.z();
  }
  EXPECT_TRUE(reported);
  EXPECT_LT(highest, 1.05 * ToolSettings{}.push_out * kCycle);
  EXPECT_NEAR(before, kHalf + rise + kCollisionMargin, 0.3 * kCollisionMargin);
}

/// As with refinement over a slow link: the surface rises through a pressed tool.
TEST(Tool, ComesOutOfASurfaceThatHasRisenFarIntoIt) {
  for (const double rise : {0.001, 0.002, 0.004, 0.008}) {
    for (const double lean : {0.0, 0.5, 1.0}) {
      SCOPED_TRACE(std::to_string(rise) + " m, leaning by " + std::to_string(lean));
      Scene scene{spm::offline::stylus(), sheet(0.04, 0, 160)};
      const Vec3d rotation{lean, 0, 0.3};
      scene.hold(at(0, 0, 0.006, rotation), 1);
      scene.lead(at(0, 0, 0.006, rotation), at(0, 0, 0.001, rotation), 50);
      scene.object.translation.z() = rise;
      scene.changed = true;
      double before = scene.tool.last().pose.position.z(), fastest = 0;
      for (int i = 0; i < 1000; ++i) {
        const double z = scene.step(at(0, 0, 0.001, rotation)).pose.position.z();
        fastest = std::max(fastest, z - before);
        before = z;
      }
      ToolPose pose = scene.tool.last().pose;
      pose.position.z() -= rise;
      EXPECT_EQ(meeting(scene.shape, scene.tool_shape, pose), 0u) << before;
      // Upwards, while the normal is tilted and the tool slides along it.
      EXPECT_LT(fastest, 1.25 * ToolSettings{}.push_out * kCycle);
      EXPECT_FALSE(scene.tool.last().outside_only);
      // Afterwards it leaves freely.
      EXPECT_LT(scene.lead(at(0, 0, 0.001, rotation), at(0, 0, 0.03, rotation), 300).displacement.norm(), 1e-9);
    }
  }
}

TEST(Tool, TheForceFallsWithinItsRateWhenASupportGivesWay) {
  Scene scene{cube(), sheet(0.1, 0, 3)};
  ToolGrip grip;
  grip.stiffness = 2000;
  scene.tool.set_grip(grip);
  scene.lead(at(0, 0, 0.015), at(0, 0, 0.008), 100);
  double before = grip.stiffness * scene.tool.last().displacement.norm(), largest = 0;
  ASSERT_GT(before, 4);
  scene.shown.show([](std::uint32_t) { return false; });
  scene.changed = true;
  int cycles = 0;
  for (; before > 1e-6 && cycles < 1000; ++cycles) {
    const double force = grip.stiffness * scene.step(at(0, 0, 0.008)).displacement.norm();
    largest = std::max(largest, before - force);
    before = force;
  }
  const double max = ToolSettings{}.max_yield * kCycle;
  EXPECT_LT(largest, 1.01 * max);
  EXPECT_LT(cycles, 1.3 * 4.2 / max);
}

TEST(Tool, StartedInASurfaceTouchesNothingUntilItIsOutside) {
  Scene scene{cube(), sheet(0.1, 0, 3)};
  EXPECT_TRUE(scene.step(at(0, 0, 0.005)).outside_only);
  EXPECT_EQ(scene.tool.last().displacement.norm(), 0);
  EXPECT_TRUE(scene.hold(at(0, 0, 0.0), 10).outside_only);
  EXPECT_FALSE(scene.step(at(0, 0, 0.011)).outside_only);
  EXPECT_GT(scene.lead(at(0, 0, 0.011), at(0, 0, 0.005), 50).displacement.z(), 0.004);
}

TEST(Tool, InputThatIsNotFiniteChangesNothing) {
  Scene scene{cube(), sheet(0.1, 0, 3)};
  scene.lead(at(0, 0, 0.02), at(0, 0, 0.005), 50);
  const ToolResult before = scene.tool.last();
  for (ToolPose bad : {at(NAN, 0, 0), at(0, INFINITY, 0), at(0, 0, 0.005)}) {
    if (bad.position.allFinite()) bad.orientation.coeffs().setConstant(NAN);
    scene.step(bad);
    EXPECT_EQ(scene.tool.last().pose.position, before.pose.position);
    EXPECT_EQ(scene.tool.last().displacement, before.displacement);
  }
}

TEST(Tool, RepeatsToTheBit) {
  const TriangleMesh organ = spm::offline::generate(spm::offline::Shape::kOrgan, 6000);
  std::vector<double> first;
  for (int run = 0; run < 2; ++run) {
    Scene scene{spm::offline::stylus(), organ, 0.3};
    scene.step(at(0, 0, 0.1));
    std::size_t i = 0;
    for (int ms = 0; ms < 600; ++ms) {
      const double t = ms * kCycle;
      const ToolResult& result = scene.step(at(0.01 * std::sin(9 * t), 0, 0.1 - 0.15 * t, {3 * t, std::sin(7 * t), t}));
      for (const double x : {result.displacement[0], result.displacement[1], result.displacement[2], result.rotation[0],
                             result.rotation[1]}) {
        if (run == 0)
          first.push_back(x);
        else
          ASSERT_EQ(std::memcmp(&x, &first[i++], sizeof x), 0) << ms;
      }
    }
    EXPECT_TRUE(scene.tool.last().in_contact);
  }
}

}  // namespace
}  // namespace tactus::haptics
