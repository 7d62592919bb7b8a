#include "haptics/proxy.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "haptics/force.hpp"
#include "tests/haptics/triangle_surface.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

using namespace testing;

constexpr unsigned kProxySeed = 20053;
constexpr double kRadius = 0.003;
constexpr double kSlack = 1.1e-6;  // m, distance that the proxy leaves to a surface

double surface_distance(const TriangleSurface& surface, const Vec3d& x) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& [a, b, c] : surface.triangles()) {
    nearest = std::min(nearest, spm::closest_point(x, a, b, c).squared_distance);
  }
  return std::sqrt(nearest);
}

/// A hand on a random walk. Outside its range it turns back towards the origin.
class RandomHand {
 public:
  RandomHand(unsigned seed, const Vec3d& start, double speed, double range)
      : random_{seed}, position_{start}, speed_{speed}, range_{range} {}
  Vec3d next() {
    std::normal_distribution<double> normal;
    heading_ += 0.05 * Vec3d{normal(random_), normal(random_), normal(random_)};
    if (position_.norm() > range_) heading_ -= 0.05 * position_.normalized();
    heading_.normalize();
    position_ += heading_ * speed_ * kCycle;
    return position_;
  }

 private:
  std::mt19937 random_;
  Vec3d position_;
  Vec3d heading_ = -Vec3d::UnitZ();
  double speed_, range_;
};

/// Moves the device from `start` to `goal` in `cycles` cycles, and then holds the device there for `cycles` cycles.
ProxyResult press(Proxy& proxy, Surface& surface, const Vec3d& start, const Vec3d& goal, int cycles) {
  for (int i = 0; i <= cycles; ++i) {
    (void)proxy.step(start + (goal - start) * (static_cast<double>(i) / cycles), kCycle, surface, false);
  }
  for (int i = 0; i < cycles; ++i) (void)proxy.step(goal, kCycle, surface, false);
  return proxy.last();
}

/// A proxy and its force on a hand.
struct ProxyForce {
  explicit ProxyForce(const ContactImpedance& material_feel) : impedance{material_feel} {}
  /// `previous`: the surface of the last cycle, if the surface has changed.
  Vec3d step(const Vec3d& position, Surface& surface, Surface* previous = nullptr) {
    DeviceState device;
    device.position = position;
    if (proxy.started()) device.velocity = (position - last_position) / kCycle;
    last_position = position;
    const bool starts = !proxy.started();
    ProxyResult unchanged;
    if (previous != nullptr || starts)
      unchanged = proxy.unchanged(position, kCycle, previous != nullptr ? *previous : surface);
    const ProxyResult& result = proxy.step(position, kCycle, surface, previous != nullptr);
    force_ =
        renderer.step(result, device, impedance, 0, kCycle, previous != nullptr || starts ? &unchanged : nullptr).force;
    return force_;
  }
  [[nodiscard]] const Vec3d& force() const { return force_; }

  ContactImpedance impedance;
  Proxy proxy;
  ForceRenderer renderer{[] {
                           ForceSettings settings;
                           settings.soft_start = 0;
                           settings.max_slew = settings.max_speed = 1e9;
                           return settings;
                         }(),
                         DeviceSpec{}};
  Vec3d last_position = Vec3d::Zero(), force_ = Vec3d::Zero();
};

TEST(Proxy, EqualsTheDevicePositionInTheAir) {
  TriangleSurface surface{square(1, 0)};
  Proxy proxy;
  const ProxyResult result = press(proxy, surface, {0, 0, 0.1}, {0.1, 0.2, 0.05}, 10);
  EXPECT_EQ(result.proxy, Vec3d(0.1, 0.2, 0.05));
  EXPECT_EQ(result.anchor, result.proxy);
  EXPECT_FALSE(result.in_contact);
}

TEST(Proxy, RestsOnAPlaneAboveTheDeviceAndFollowsItAlongThePlane) {
  TriangleSurface surface{square(1, 0)};
  Proxy proxy;
  const ProxyResult result = press(proxy, surface, {0, 0, 0.02}, {0.1, 0.2, -0.01}, 50);
  EXPECT_LT((result.proxy - Vec3d(0.1, 0.2, kRadius)).norm(), 2e-6);
  EXPECT_TRUE(result.in_contact);
  EXPECT_LT((result.normal - Vec3d::UnitZ()).norm(), 1e-6);
  EXPECT_EQ(result.object, 0u);
}

TEST(Proxy, LeavesASurfaceWithoutSticking) {
  TriangleSurface surface{square(1, 0)};
  Proxy proxy;
  (void)press(proxy, surface, {0, 0, 0.02}, {0, 0, -0.01}, 20);
  const ProxyResult result = press(proxy, surface, {0, 0, -0.01}, {0, 0, 0.01}, 20);
  EXPECT_EQ(result.proxy, Vec3d(0, 0, 0.01));
  EXPECT_FALSE(result.in_contact);
}

TEST(Proxy, RestsOnBothSidesOfAGroove) {
  // Two slopes of 45 degrees that intersect along the y axis.
  TriangleSurface surface{sheet({0, -1, 0}, {1, 0, 1}, {0, 2, 0}) + sheet({0, -1, 0}, {0, 2, 0}, {-1, 0, 1})};
  Proxy proxy;
  const ProxyResult result = press(proxy, surface, {0.02, 0, 0.1}, {0.001, 0.03, -0.05}, 100);
  EXPECT_LT((result.proxy - Vec3d(0, 0.03, kRadius * std::sqrt(2.0))).norm(), 5e-6);
}

TEST(Proxy, RestsOnThreeSidesOfACorner) {
  TriangleSurface surface{sheet({0, 0, 0}, {1, 0, 0}, {0, 1, 0}) + sheet({0, 0, 0}, {0, 1, 0}, {0, 0, 1}) +
                          sheet({0, 0, 0}, {0, 0, 1}, {1, 0, 0})};
  Proxy proxy;
  const ProxyResult result = press(proxy, surface, {0.1, 0.12, 0.15}, {-0.05, -0.02, -0.03}, 100);
  EXPECT_LT((result.proxy - Vec3d(kRadius, kRadius, kRadius)).norm(), 5e-6);
}

TEST(Proxy, SlidesOverAConvexEdge) {
  // The device moves over the edge of a step to a point beside the step, below the top face.
  TriangleSurface surface{sheet({-1, -1, 0}, {1, 0, 0}, {0, 2, 0}) + sheet({0, -1, 0}, {0, 0, -1}, {0, 2, 0})};
  Proxy proxy;
  (void)press(proxy, surface, {-0.05, 0, 0.02}, {-0.05, 0, -0.002}, 20);
  const ProxyResult result = press(proxy, surface, {-0.05, 0, -0.002}, {0.02, 0, -0.002}, 200);
  EXPECT_LT((result.proxy - Vec3d(0.02, 0, -0.002)).norm(), 1e-12);
  EXPECT_FALSE(result.in_contact);
}

TEST(Proxy, DoesNotPassASheetThinnerThanTheMotionOfACycle) {
  TriangleSurface surface{square(1, 0) + square(1, -1e-5)};
  for (const double speed : {0.05, 0.5, 5.0, 500.0}) {
    Proxy proxy;
    Vec3d device{0.01, 0.02, 0.05};
    (void)proxy.step(device, kCycle, surface, false);
    while (device.z() > -0.2) {
      device.z() -= speed * kCycle;
      ASSERT_GE(proxy.step(device, kCycle, surface, false).proxy.z(), kRadius) << speed << " m/s";
    }
  }
}

TEST(Proxy, DoesNotPassDuplicatedOrDegenerateFacesOrNonManifoldEdges) {
  std::vector<Triangle> faces = square(1, 0) + square(1, 0);
  faces.push_back({Vec3d{0, 0, 0}, Vec3d{0.5, 0.5, 0}, Vec3d{0.25, 0.25, 0}});
  faces.push_back({Vec3d{0.1, 0.1, 0}, Vec3d{0.1, 0.1, 0}, Vec3d{0.1, 0.1, 0}});
  faces.push_back({faces[0][2], faces[0][1], faces[0][0]});
  // A perpendicular sheet on the diagonal of the square gives this edge three or more faces.
  faces = faces + sheet({-0.5, -0.5, 0}, {1, 1, 0}, {0, 0, 0.01});
  TriangleSurface surface{faces};
  for (unsigned seed = 0; seed < 4; ++seed) {
    Proxy proxy;
    const Vec3d start{0.1, -0.1, 0.05};
    RandomHand hand{kProxySeed + seed, start, 0.3, 0.15};
    (void)proxy.step(start, kCycle, surface, false);
    for (int i = 0; i < 3000; ++i) {
      const Vec3d x = proxy.step(hand.next(), kCycle, surface, false).proxy;
      ASSERT_GE(surface_distance(surface, x), kRadius - 1e-12) << "seed " << seed << " cycle " << i;
      ASSERT_GT(x.z(), 0);
    }
  }
}

TEST(Proxy, PassesAroundAnOpenBorderAndThenTouchesTheBackOfTheSheet) {
  TriangleSurface surface{square(0.1, 0)};
  Proxy proxy;
  (void)press(proxy, surface, {0, 0, 0.02}, {0.08, 0, 0.02}, 100);
  (void)press(proxy, surface, {0.08, 0, 0.02}, {0.08, 0, -0.02}, 100);
  (void)press(proxy, surface, {0.08, 0, -0.02}, {0, 0, -0.02}, 100);
  const ProxyResult result = press(proxy, surface, {0, 0, -0.02}, {0, 0, 0.01}, 100);
  EXPECT_NEAR(result.proxy.z(), -kRadius, 2e-6);
  EXPECT_FALSE(result.outside_only);
}

TEST(Proxy, StartedInsideTouchesNothingUntilItIsOutside) {
  TriangleSurface surface{sphere(0.1, 2)};
  Proxy proxy;
  EXPECT_TRUE(proxy.step({0, 0, 0.02}, kCycle, surface, false).outside_only);
  for (double z = 0.02; z < 0.12; z += 0.001) {
    const ProxyResult& result = proxy.step({0, 0, z}, kCycle, surface, false);
    ASSERT_EQ(result.proxy, Vec3d(0, 0, z));
    ASSERT_EQ(result.anchor, result.proxy);
  }
  EXPECT_FALSE(proxy.last().outside_only);
  const ProxyResult result = press(proxy, surface, {0, 0, 0.12}, {0, 0, 0.05}, 100);
  EXPECT_TRUE(result.in_contact);
  EXPECT_GT(result.proxy.z(), 0.1);
}

TEST(Proxy, TouchesNothingInsideASurfaceThatAppearsUntilItIsOutside) {
  TriangleSurface nothing;
  TriangleSurface surface{sphere(0.1, 2)};
  Proxy proxy;
  (void)press(proxy, nothing, {0, 0, 0.3}, {0, 0, 0.03}, 10);
  const ProxyResult& result = proxy.step({0, 0, 0.03}, kCycle, surface, true);
  EXPECT_TRUE(result.outside_only);
  EXPECT_EQ(result.anchor, Vec3d(0, 0, 0.03));
}

TEST(Proxy, IsPushedGraduallyOutOfASurfaceThatAppears) {
  TriangleSurface nothing;
  TriangleSurface surface{sphere(0.1, 2)};
  const Vec3d device{0, 0, 0.1 + kRadius - 0.0005};  // 0.5 mm deep
  for (const bool starts_at_surface : {false, true}) {
    ProxyForce probe{{2000, 0}};
    if (!starts_at_surface) (void)probe.step(device, nothing);
    double force = 0;
    for (int i = 0; i < 40; ++i) {
      const double next_force = probe.step(device, surface, i == 0 ? &nothing : nullptr).z();
      ASSERT_TRUE(probe.proxy.last().in_contact) << "cycle " << i;
      ASSERT_LE(next_force - force, 0.0451) << "cycle " << i;
      force = next_force;
    }
    EXPECT_NEAR(force, 1, 0.01);
  }
}

TEST(Proxy, StaysEqualBitForBitWhenAReportedChangeChangesNothing) {
  TriangleSurface surface{bumpy(0.05, 2, 0.2)};
  for (const double friction : {0.0, 0.5}) {
    Proxy reported, unreported;
    const Vec3d start{0.02, -0.01, 0.12};
    RandomHand hand{kProxySeed, start, 0.2, 0.07};
    int contacts = 0;
    for (int i = 0; i < 5000; ++i) {
      const Vec3d device = hand.next();
      for (Proxy* proxy : {&reported, &unreported}) proxy->set_grip({friction, 0.8 * friction});
      const ProxyResult& with_report = reported.step(device, kCycle, surface, i % 3 == 0);
      const ProxyResult& without_report = unreported.step(device, kCycle, surface, false);
      ASSERT_EQ(with_report.proxy, without_report.proxy) << "seed " << kProxySeed << " cycle " << i;
      ASSERT_EQ(with_report.anchor, without_report.anchor) << "seed " << kProxySeed << " cycle " << i;
      contacts += with_report.in_contact ? 1 : 0;
    }
    EXPECT_GT(contacts, 500);
  }
}

TEST(Proxy, NeverEntersAClosedSurface) {
  // Random hands at up to 0.5 m/s; 10^5 cycles in total.
  for (const auto& triangles : {tetrahedron(0.05), sphere(0.05, 2), bumpy(0.05, 2, 0.25)}) {
    TriangleSurface surface{triangles};
    for (const double friction : {0.0, 0.6}) {
      for (unsigned seed = 0; seed < 4; ++seed) {
        Proxy proxy;
        proxy.set_grip({friction, 0.7 * friction});
        const Vec3d start{0.02, -0.01, 0.12};
        RandomHand hand{kProxySeed + seed, start, 0.05 + 0.15 * seed, 0.08};
        (void)proxy.step(start, kCycle, surface, false);
        int contacts = 0;
        for (int i = 0; i < 4200; ++i) {
          const ProxyResult& result = proxy.step(hand.next(), kCycle, surface, false);
          if (!result.in_contact) continue;
          ++contacts;
          ASSERT_GE(surface_distance(surface, result.proxy), kRadius - 1e-12)
              << "seed " << kProxySeed + seed << " cycle " << i;
          ASSERT_LT(std::abs(winding_number(result.proxy, triangles)), 0.5)
              << "seed " << kProxySeed + seed << " cycle " << i;
        }
        EXPECT_GT(contacts, 100);
      }
    }
  }
}

TEST(Proxy, ConvergesToALocalMinimumOfTheDistance) {
  // No allowed point around the proxy is closer to the device.
  TriangleSurface surface{bumpy(0.05, 2, 0.2)};
  std::mt19937 random{kProxySeed};
  std::normal_distribution<double> normal;
  for (int round = 0; round < 60; ++round) {
    const Vec3d direction = Vec3d{normal(random), normal(random), normal(random)}.normalized();
    Proxy proxy;
    const Vec3d device = direction * 0.03;
    const ProxyResult result = press(proxy, surface, direction * 0.1, device, 100);
    ASSERT_TRUE(result.in_contact);
    for (int sample = 0; sample < 200; ++sample) {
      const Vec3d nearby = result.proxy + 2e-4 * Vec3d{normal(random), normal(random), normal(random)};
      if (surface_distance(surface, nearby) < kRadius + 2 * kSlack) continue;
      ASSERT_GT((nearby - device).norm(), (result.proxy - device).norm() - 1e-5)
          << "seed " << kProxySeed << " round " << round;
    }
  }
}

TEST(Proxy, KeepsItsSideWhenRefinementMovesTheSurfacePastIt) {
  const auto coarse = bumpy(0.05, 1, 0.1);
  const auto fine = bumpy(0.05, 3, 0.1);
  TriangleSurface surfaces[2]{TriangleSurface{coarse}, TriangleSurface{fine}};
  ProxySettings settings;
  settings.reach = 0.02;
  int moved = 0;
  for (unsigned seed = 0; seed < 6; ++seed) {
    Proxy proxy{settings};
    const Vec3d start{0.02, -0.01, 0.12};
    RandomHand hand{kProxySeed + seed, start, 0.2, 0.07};
    int shown = 0;
    (void)proxy.step(start, kCycle, surfaces[shown], false);
    for (int i = 0; i < 3000; ++i) {
      const bool change = i % 50 == 49;
      if (change) shown = 1 - shown;
      const ProxyResult& result = proxy.step(hand.next(), kCycle, surfaces[shown], change);
      if (result.surface_moved) ++moved;
      if (!change && !result.in_contact) continue;
      ASSERT_LT(std::abs(winding_number(result.proxy, surfaces[shown].triangles())), 0.5)
          << "seed " << kProxySeed + seed << " cycle " << i;
    }
  }
  EXPECT_GT(moved, 50);
}

TEST(Proxy, StaysBehindAnOpenSheetThatMovesPastIt) {
  TriangleSurface sheet_before{square(0.1, 0)};
  TriangleSurface sheet_after{square(0.1, -0.006)};
  Proxy proxy;
  (void)press(proxy, sheet_before, {0, 0, 0.02}, {0.08, 0, 0.02}, 100);
  (void)press(proxy, sheet_before, {0.08, 0, 0.02}, {0.08, 0, -0.02}, 100);
  (void)press(proxy, sheet_before, {0.08, 0, -0.02}, {0, 0, -0.004}, 100);
  const ProxyResult& result = proxy.step({0, 0, -0.004}, kCycle, sheet_after, true);
  EXPECT_TRUE(result.surface_moved);
  EXPECT_NEAR(result.proxy.z(), -0.006 - kRadius, 3e-6);
}

TEST(Proxy, KeepsItsCentreOutsideWhenRefinementNarrowsAGapBelowItsSize) {
  // Two blocks approach the tip until the gap between them is narrower than the tip.
  const auto block = [](double x) { return sheet({x, -0.1, -0.1}, {0, 0.2, 0}, {0, 0, 0.2}); };
  const auto facing = [](double x) { return sheet({x, -0.1, -0.1}, {0, 0, 0.2}, {0, 0.2, 0}); };
  TriangleSurface wide{block(-0.005) + facing(0.005)};
  TriangleSurface narrow{block(-0.0012) + facing(0.0018)};
  Proxy proxy;
  (void)press(proxy, wide, {0.001, 0, 0.02}, {-0.0019, 0, 0.01}, 20);
  for (int i = 0; i < 50; ++i) {
    const Vec3d& x = proxy.step({-0.0019, 0, 0.01}, kCycle, narrow, i == 0).proxy;
    ASSERT_GT(x.x(), -0.0012) << "cycle " << i;
    ASSERT_LT(x.x(), 0.0018) << "cycle " << i;
  }
}

TEST(Proxy, RampsTheForceWhenTheSurfaceRisesOrFallsUnderAHeldDevice) {
  TriangleSurface low{square(1, 0)};
  TriangleSurface high{square(1, 0.004)};
  ProxyForce probe{{2000, 0}};
  const Vec3d device{0, 0, 0.001};
  for (int i = 0; i < 100; ++i) (void)probe.step(device + Vec3d{0, 0, 0.05 * (1 - i / 99.0)}, low);
  double force = probe.force().z();
  EXPECT_NEAR(force, 2000 * (kRadius - 0.001), 0.01);
  TriangleSurface* shown = &low;
  const auto change_to = [&](TriangleSurface& surface) {
    double max_change = 0;
    for (int i = 0; i < 400; ++i) {
      const double next_force = probe.step(device, surface, i == 0 ? shown : nullptr).z();
      EXPECT_EQ(probe.proxy.last().surface_moved, i == 0);
      max_change = std::max(max_change, std::abs(next_force - force));
      force = next_force;
    }
    shown = &surface;
    return max_change;
  };
  EXPECT_LE(change_to(high), 0.0451);
  EXPECT_NEAR(force, 8, 0.01);  // the maximum force; stiffness times depth is 12 N
  EXPECT_LE(change_to(low), 0.0451);
  EXPECT_NEAR(force, 2000 * (kRadius - 0.001), 0.01);
}

TEST(Proxy, NeverPullsDuringARampWhileTheDeviceLeaves) {
  TriangleSurface low{square(1, 0)};
  TriangleSurface high{square(1, 0.004)};
  ProxyForce probe{{2000, 0}};
  for (int i = 0; i < 100; ++i) (void)probe.step({0, 0, 0.001 + 0.05 * (1 - i / 99.0)}, low);
  for (int i = 0; i < 100; ++i)
    ASSERT_GE(probe.step({0, 0, 0.001 + i * 2e-4}, high, i == 0 ? &low : nullptr).z(), -1e-9) << "cycle " << i;
}

TEST(Proxy, TheForceIsAsOnThePreviousSurfaceInTheCycleOfAChange) {
  // A random hand touches a body whose resolution changes. In the cycle of a change the force equals the force of a
  // copy on the previous surface. Afterwards the force changes with the hand and by the ramp.
  const auto coarse = bumpy(0.05, 1, 0.1);
  const auto fine = bumpy(0.05, 3, 0.1);
  TriangleSurface surfaces[2]{TriangleSurface{coarse}, TriangleSurface{fine}};
  int changes = 0, jumps = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    ProxyForce probe{{2000, 1}};
    probe.proxy.set_grip({0.5, 0.4});
    const Vec3d start{0.02, -0.01, 0.12};
    RandomHand hand{kProxySeed + seed, start, 0.2, 0.07};
    int shown = 0;
    (void)probe.step(start, surfaces[shown]);
    for (int i = 0; i < 3000; ++i) {
      const Vec3d device = hand.next();
      if (i % 50 != 49) {
        (void)probe.step(device, surfaces[shown]);
        continue;
      }
      ProxyForce unchanged = probe, without_ramp = probe;
      (void)unchanged.step(device, surfaces[shown]);
      (void)without_ramp.proxy.step(device, kCycle, surfaces[1 - shown], true);
      (void)probe.step(device, surfaces[1 - shown], &surfaces[shown]);
      shown = 1 - shown;
      ASSERT_LT((probe.force() - unchanged.force()).norm(), 1e-12) << "seed " << kProxySeed + seed << " cycle " << i;
      ++changes;
      jumps += (without_ramp.proxy.last().proxy - unchanged.proxy.last().proxy).norm() > 1e-4 ? 1 : 0;
    }
  }
  EXPECT_GT(changes, 200);
  EXPECT_GT(jumps, 20) << "otherwise no ramp was tested";
}

TEST(Proxy, SticksInsideTheFrictionConeAndSlipsOutsideIt) {
  TriangleSurface surface{square(1, 0)};
  Proxy proxy;
  proxy.set_grip({0.5, 0.3});
  const double depth = 0.01;
  (void)press(proxy, surface, {0, 0, 0.02}, {0, 0, kRadius - depth}, 30);
  ProxyResult result = press(proxy, surface, {0, 0, kRadius - depth}, {0.0045, 0, kRadius - depth}, 30);
  EXPECT_TRUE(result.sticking);
  EXPECT_NEAR(result.proxy.x(), 0, 1e-6);
  for (double x = 0.0045; x < 0.05; x += 1e-4) {
    result = proxy.step({x, 0, kRadius - depth}, kCycle, surface, false);
    if (x < 0.0055) continue;
    ASSERT_FALSE(result.sticking);
    // The proxy follows on the dynamic cone: its tangential distance is 0.3 times the depth.
    ASSERT_NEAR(x - result.proxy.x(), 0.3 * depth, 1e-5);
  }
}

TEST(Proxy, KeepsSlippingUntilItIsWellInsideTheStaticCone) {
  TriangleSurface surface{square(1, 0)};
  Proxy proxy;
  proxy.set_grip({0.5, 0.45});
  const double z = kRadius - 0.01;
  (void)press(proxy, surface, {0, 0, 0.02}, {0, 0, z}, 30);
  (void)press(proxy, surface, {0, 0, z}, {0.05, 0, z}, 100);
  const double x_before = proxy.last().proxy.x();
  // A distance of 0.45 times the depth is inside the static cone, but the proxy still slips at the next motion.
  const ProxyResult& result = proxy.step({0.051, 0, z}, kCycle, surface, false);
  EXPECT_FALSE(result.sticking);
  EXPECT_GT(result.proxy.x(), x_before + 5e-4);
}

TEST(Proxy, StaysWhereItWasWhenTheDeviceIsNotFinite) {
  TriangleSurface surface{square(1, 0)};
  Proxy proxy;
  const Vec3d before = press(proxy, surface, {0, 0, 0.02}, {0, 0, -0.01}, 20).proxy;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(proxy.step({nan, 0, 0}, kCycle, surface, false).proxy, before);
}

}  // namespace
}  // namespace tactus::haptics
