#include "haptics/force.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "haptics/rigid_body.hpp"

namespace tactus::haptics {
namespace {

constexpr unsigned kSeed = 20054;
constexpr double kCycle = 1e-3;
constexpr double kFresh = 1e-4;

ForceSettings at_full_strength() {
  ForceSettings settings;
  settings.soft_start = 0;
  settings.max_slew = 1e9;
  return settings;
}

/// A contact with a floor: the anchor is `depth` above the device.
ProxyResult floor_contact(double depth) {
  ProxyResult proxy;
  proxy.proxy = proxy.anchor = {0, 0, depth};
  proxy.in_contact = true;
  return proxy;
}

DeviceState device_moving(double upwards) {
  DeviceState device;
  device.velocity = {0.3, 0, upwards};
  return device;
}

TEST(Force, IsStiffnessTimesDepthWithDampingAlongTheNormalOnly) {
  ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
  const Vec3d force = renderer.step(floor_contact(0.002), device_moving(-0.1), {1000, 2}, kFresh, kCycle).force;
  EXPECT_LT((force - Vec3d(0, 0, 2.0 + 0.2)).norm(), 1e-12);
}

TEST(Force, DampingNeverPullsTheHandBackToTheSurface) {
  ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
  const ForceResult result = renderer.step(floor_contact(0.0001), device_moving(0.5), {1000, 2}, kFresh, kCycle);
  EXPECT_GE(result.force.z(), 0);
}

TEST(Force, IsZeroInTheAirAtAnySpeed) {
  ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
  const ForceResult result = renderer.step(ProxyResult{}, device_moving(-0.5), {1000, 2}, kFresh, kCycle);
  EXPECT_EQ(result.force, Vec3d(Vec3d::Zero()));
  EXPECT_EQ(result.bits, 0u);
}

TEST(Force, SaturatesAtTheSmallerOfItsLimitAndTheDevices) {
  DeviceSpec weak;
  weak.max_force = 3;
  ForceRenderer renderer{at_full_strength(), weak};
  const ForceResult result = renderer.step(floor_contact(0.1), DeviceState{}, {1000, 0}, kFresh, kCycle);
  EXPECT_NEAR(result.force.norm(), 3, 1e-12);
  EXPECT_TRUE(result.bits & kForceSaturated);
}

TEST(Force, StartsSoftly) {
  ForceSettings settings;
  ForceRenderer renderer{settings, DeviceSpec{}};
  double before = 0;
  for (int i = 1; i <= 500; ++i) {
    const ForceResult& result = renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFresh, kCycle);
    ASSERT_NEAR(result.force.z(), 2.0 * i * kCycle / settings.soft_start, 1e-9);
    ASSERT_EQ((result.bits & kForceSoftStart) != 0, i < 500) << i;
    ASSERT_GT(result.force.z(), before);
    before = result.force.z();
  }
}

TEST(Force, HoldsThenFadesToZeroForAStalePose) {
  ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
  (void)renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle);
  double before = 2;
  for (int ms = 1; ms <= 100; ++ms) {
    const ForceResult& result = renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, ms * kCycle, kCycle);
    if (ms <= 10) {
      ASSERT_NEAR(result.force.z(), 2, 1e-9) << ms;
    }
    if (ms > 10 && ms < 60) {
      ASSERT_LT(result.force.z(), before) << ms;
    }
    if (ms >= 60) {
      ASSERT_EQ(result.force, Vec3d(Vec3d::Zero())) << ms;
    }
    ASSERT_EQ((result.bits & kForceStale) != 0, ms > 10) << ms;
    before = result.force.z();
  }
  // With fresh poses the force returns over the recovery time.
  EXPECT_LT(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle).force.z(), 0.1);
  for (int i = 0; i < 100; ++i) (void)renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle);
  EXPECT_NEAR(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle).force.z(), 2, 1e-9);
}

TEST(Force, LatchesZeroWhenAnyInputIsNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (int which = 0; which < 6; ++which) {
    ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
    ProxyResult proxy = floor_contact(0.002);
    DeviceState device;
    ContactImpedance impedance{1000, 1};
    double age = kFresh;
    if (which == 0) proxy.anchor.x() = nan;
    if (which == 1) proxy.normal.y() = infinity;
    if (which == 2) device.position.z() = nan;
    if (which == 3) device.velocity.x() = infinity;
    if (which == 4) impedance.stiffness = nan;
    if (which == 5) age = nan;
    (void)renderer.step(proxy, device, impedance, age, kCycle);
    for (int i = 0; i < 5; ++i) {
      const ForceResult& result = renderer.step(floor_contact(0.002), DeviceState{}, {1000, 1}, kFresh, kCycle);
      ASSERT_EQ(result.force, Vec3d(Vec3d::Zero())) << which;
      ASSERT_EQ(result.fault, Fault::kInputNotFinite) << which;
      ASSERT_TRUE(result.bits & kForceFault) << which;
    }
    renderer.reset();
    EXPECT_GT(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 1}, kFresh, kCycle).force.z(), 1);
  }
}

TEST(Force, ReportsTheFirstFaultUntilReset) {
  ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
  renderer.latch(Fault::kEmergencyStop);
  renderer.latch(Fault::kDeviceFailed);
  EXPECT_EQ(renderer.step(floor_contact(1), DeviceState{}, {}, kFresh, kCycle).fault, Fault::kEmergencyStop);
}

TEST(Force, LatchesAtExcessSpeedOnlyWhileAForceActs) {
  ForceSettings settings = at_full_strength();
  DeviceState fast = device_moving(0);
  fast.velocity = {settings.max_speed + 0.1, 0, 0};
  ForceRenderer reported{settings, DeviceSpec{}};
  EXPECT_EQ(reported.step(ProxyResult{}, fast, {1000, 0}, kFresh, kCycle).fault, Fault::kNone);
  EXPECT_EQ(reported.step(floor_contact(0.002), fast, {1000, 0}, kFresh, kCycle).fault, Fault::kNone);
  const ForceResult& result = reported.step(floor_contact(0.002), fast, {1000, 0}, kFresh, kCycle);
  EXPECT_EQ(result.fault, Fault::kTooFast);
  EXPECT_EQ(result.force, Vec3d(Vec3d::Zero()));

  // A device that reports zero velocity while its positions jump.
  ForceRenderer seen{settings, DeviceSpec{}};
  DeviceState jumping;
  EXPECT_EQ(seen.step(floor_contact(0.002), jumping, {1000, 0}, kFresh, kCycle).fault, Fault::kNone);
  jumping.position.x() += (settings.max_speed + 0.1) * kCycle;
  EXPECT_EQ(seen.step(floor_contact(0.002), jumping, {1000, 0}, kFresh, kCycle).fault, Fault::kTooFast);
}

TEST(Force, AllowsALargerDistanceAfterALatePose) {
  ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
  DeviceState device;
  (void)renderer.step(floor_contact(0.002), device, {1000, 0}, kFresh, kCycle);
  device.position.x() += 0.01;
  device.time_ns += 20'000'000;
  EXPECT_EQ(renderer.step(floor_contact(0.002), device, {1000, 0}, kFresh, kCycle).fault, Fault::kNone);
}

TEST(Force, ReportsEachBitOnceWhenItBegins) {
  ForceSettings settings = at_full_strength();
  settings.max_force = 1;
  ForceRenderer renderer{settings, DeviceSpec{}};
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFresh, kCycle).began, kForceSaturated);
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFresh, kCycle).began, 0u);
  renderer.latch(Fault::kEmergencyStop);
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFresh, kCycle).began, kForceFault);
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFresh, kCycle).began, 0u);
}

TEST(Force, CutsAStiffnessThatTheDeviceCannotRenderStably) {
  ForceSettings settings = at_full_strength();
  settings.max_force = 1e9;
  DeviceSpec spec;
  spec.damping = 1;
  spec.max_force = 1e9;
  ForceRenderer renderer{settings, spec};
  const ForceResult result = renderer.step(floor_contact(0.001), DeviceState{}, {10000, 0}, kFresh, kCycle);
  EXPECT_NEAR(result.force.z(), 2.0, 1e-9);  // 1 N s/m over half a millisecond: 2000 N/m
  EXPECT_TRUE(result.bits & kForceStiffnessCut);
  EXPECT_NEAR(stable_stiffness(5, 0, 1e-3, 0.020), 244, 0.5);  // notes of Hulin's rule, 20 ms delay
}

TEST(Force, MarksTheRampOfASurfaceThatMoved) {
  ForceRenderer renderer{at_full_strength(), DeviceSpec{}};
  const ProxyResult risen = floor_contact(0.001), before = floor_contact(0.0009);
  EXPECT_FALSE(renderer.step(before, DeviceState{}, {1000, 0}, kFresh, kCycle).bits & kForceSurfaceRamp);
  EXPECT_TRUE(renderer.step(risen, DeviceState{}, {1000, 0}, kFresh, kCycle, &before).bits & kForceSurfaceRamp);
  for (int i = 0; i < 2; ++i)  // 0.1 N at 45 N/s
    EXPECT_TRUE(renderer.step(risen, DeviceState{}, {1000, 0}, kFresh, kCycle).bits & kForceSurfaceRamp);
  EXPECT_FALSE(renderer.step(risen, DeviceState{}, {1000, 0}, kFresh, kCycle).bits & kForceSurfaceRamp);
}

TEST(Force, KeepsItsLimitsForAnyInput) {
  std::mt19937 random{kSeed};
  const auto wild = [&] {
    const double size = std::pow(10, std::uniform_real_distribution<double>{-6, 6}(random));
    const double pick = std::uniform_real_distribution<double>{0, 1}(random);
    if (pick < 0.0005) return std::numeric_limits<double>::quiet_NaN();
    return pick < 0.5 ? -size : size;
  };
  const ForceSettings settings;
  ForceRenderer renderer{settings, DeviceSpec{}};
  Vec3d before = Vec3d::Zero();
  for (int i = 0; i < 200000; ++i) {
    ProxyResult proxy;
    proxy.anchor = {wild(), wild(), wild()};
    proxy.in_contact = i % 3 != 0;
    proxy.normal = Vec3d{wild(), wild(), wild()}.normalized();
    DeviceState device;
    device.position = {wild(), wild(), wild()};
    device.velocity = {wild(), wild(), wild()};
    const double age = std::abs(wild()) * 1e-3;
    ProxyResult unchanged = proxy;
    if (i % 5 == 0) unchanged.anchor = {wild(), wild(), wild()};
    const ForceResult& result = renderer.step(proxy, device, {std::abs(wild()), std::abs(wild())}, age, kCycle,
                                              i % 5 == 0 ? &unchanged : nullptr);
    ASSERT_TRUE(result.force.allFinite()) << "seed " << kSeed << " step " << i;
    ASSERT_LE(result.force.norm(), settings.max_force + 1e-9) << "seed " << kSeed << " step " << i;
    if (age >= settings.zero_force_age) {
      ASSERT_EQ(result.force, Vec3d(Vec3d::Zero()));
    }
    if (!result.force.isZero(0)) {
      ASSERT_LE((result.force - before).norm(), settings.max_slew * kCycle + 1e-9) << "seed " << kSeed << " step " << i;
    }
    before = result.force;
    if (result.fault != Fault::kNone) renderer.reset();
  }
}

// ---- of a tool ----

ToolResult pressed_tool(double depth, double angle) {
  ToolResult tool;
  tool.in_contact = true;
  tool.displacement = {0, 0, depth};
  tool.rotation = {angle, 0, 0};
  return tool;
}

DeviceSpec bearing(double torque) {
  DeviceSpec spec;
  spec.max_torque = torque;
  return spec;
}

TEST(Force, OfAToolIsAWrenchOfItsCoupling) {
  ForceSettings settings = at_full_strength();
  settings.max_torque_slew = 1e9;
  ForceRenderer renderer{settings, bearing(1)};
  const ContactImpedance impedance{1000, 0};
  const ToolGrip grip = renderer.tool_grip(impedance, kCycle);
  EXPECT_EQ(grip.stiffness, 1000);
  EXPECT_NEAR(grip.rotational_stiffness, 0.1, 1e-15);
  const ForceResult& result = renderer.step(pressed_tool(0.002, 0.5), grip, DeviceState{}, impedance, kFresh, kCycle);
  EXPECT_LT((result.force - Vec3d(0, 0, 2)).norm(), 1e-12);
  EXPECT_LT((result.torque - Vec3d(0.05, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(result.bits, 0u);
}

/// rad; amplitude, after 1 s, of a device of 10^-4 kg m^2 without damping that swings about a held tool.
double swings(double angular_damping) {
  ForceSettings settings = at_full_strength();
  ForceRenderer renderer{settings, bearing(1)};
  const ContactImpedance impedance{1000, 0};
  ToolGrip grip = renderer.tool_grip(impedance, kCycle);
  grip.angular_damping *= angular_damping;
  double angle = 0.2, angular_velocity = 0, widest = 0;
  for (int i = 0; i < 1200; ++i) {
    DeviceState device;
    device.orientation = exp_map({angle, 0, 0});
    device.time_ns = 1'000'000 * i;
    const Vec3d torque = renderer.step(pressed_tool(0.001, -angle), grip, device, impedance, kFresh, kCycle).torque;
    angular_velocity += kCycle * torque.x() / 1e-4;
    angle += kCycle * angular_velocity;
    if (i >= 1000) widest = std::max(widest, std::abs(angle));
  }
  return widest;
}

TEST(Force, ADeviceRotatedAgainstAToolComesToRest) {
  EXPECT_GT(swings(0), 0.15);
  EXPECT_LT(swings(1), 0.02);
}

TEST(Force, OfAHoldActsInSixDegreesOfFreedomAndDampsRelativeMotion) {
  ForceSettings settings = at_full_strength();
  settings.max_torque_slew = 1e9;
  ForceRenderer renderer{settings, bearing(1)}, weak{settings, bearing(0)};
  const ContactImpedance impedance{1000, 3};
  const ToolGrip grip = renderer.hold_grip(impedance, kCycle);
  EXPECT_EQ(grip.rotational_stiffness, 1) << "the limit of the device";
  EXPECT_NEAR(weak.hold_grip(impedance, kCycle).rotational_stiffness, 2.5, 1e-12)
      << "no limit for a device without torque";
  Hold hold;
  hold.pose.position = {0.001, 0, -0.002};
  hold.pose.orientation = exp_map({0, 0.1, 0});
  hold.velocity = {0, 0.1, 0};
  hold.angular_velocity = {0, 0, 2};
  DeviceState device;
  device.velocity = {0, 0, 0.2};
  const ForceResult& result = renderer.step(hold, grip, device, impedance, kFresh, kCycle);
  EXPECT_LT((result.force - Vec3d(1, 0.3, -2.6)).norm(), 1e-12);
  EXPECT_LT((result.torque - Vec3d(0, 0.1, 0.02)).norm(), 1e-12);
  EXPECT_EQ(result.bits, 0u);
  EXPECT_TRUE(weak.step(hold, grip, device, impedance, kFresh, kCycle).torque.isZero(0));
  hold.pose.position.x() = 1;
  EXPECT_NEAR(renderer.step(hold, grip, device, impedance, kFresh, kCycle).force.norm(), settings.max_force, 1e-9);
  hold.angular_velocity.x() = std::nan("");
  EXPECT_EQ(renderer.step(hold, grip, device, impedance, kFresh, kCycle).fault, Fault::kInputNotFinite);
  EXPECT_TRUE(renderer.step(Hold{}, grip, device, impedance, kFresh, kCycle).force.isZero(0));
}

TEST(Force, LimitsTorqueAndItsRateAndOmitsItForAForceOnlyDevice) {
  ForceSettings settings = at_full_strength();
  settings.max_torque = 0.08;
  settings.max_torque_slew = 20;
  const ContactImpedance impedance{1000, 0};
  ForceRenderer renderer{settings, bearing(1)}, weak{settings, bearing(0.05)}, none{settings, bearing(0)};
  const ToolGrip grip = renderer.tool_grip(impedance, kCycle);
  const ToolResult tool = pressed_tool(0, 2);
  EXPECT_NEAR(renderer.step(tool, grip, {}, impedance, kFresh, kCycle).torque.norm(), 0.02, 1e-12);
  EXPECT_NE(renderer.step(tool, grip, {}, impedance, kFresh, kCycle).bits & kForceSlewLimited, 0u);
  for (int i = 0; i < 10; ++i) {
    static_cast<void>(renderer.step(tool, grip, {}, impedance, kFresh, kCycle));
    static_cast<void>(weak.step(tool, grip, {}, impedance, kFresh, kCycle));
  }
  const ForceResult& result = renderer.step(tool, grip, {}, impedance, kFresh, kCycle);
  EXPECT_NEAR(result.torque.norm(), 0.08, 1e-12);
  EXPECT_EQ(result.bits, std::uint32_t{kForceSaturated});
  EXPECT_NEAR(weak.step(tool, grip, {}, impedance, kFresh, kCycle).torque.norm(), 0.05, 1e-12);
  EXPECT_TRUE(none.step(tool, grip, {}, impedance, kFresh, kCycle).torque.isZero(0));
  EXPECT_EQ(none.step(tool, grip, {}, impedance, kFresh, kCycle).bits, 0u);
}

TEST(Force, AFaultEndsATorqueAndFastRotationAgainstATorqueIsAFault) {
  const ContactImpedance impedance{1000, 0};
  const auto felt = [&](ForceRenderer& renderer, const DeviceState& device, double pose_age) -> const ForceResult& {
    return renderer.step(pressed_tool(0, 0.5), renderer.tool_grip(impedance, kCycle), device, impedance, pose_age,
                         kCycle);
  };
  DeviceState turned;
  turned.orientation = exp_map({0, 0, 0.1});  // in a millisecond
  turned.time_ns = 1'000'000;
  DeviceState broken;
  broken.orientation.coeffs().setZero();
  for (const auto& [device, fault] : {std::pair{turned, Fault::kTooFast}, std::pair{broken, Fault::kInputNotFinite}}) {
    ForceRenderer renderer{at_full_strength(), bearing(1)};
    EXPECT_GT(felt(renderer, {}, kFresh).torque.norm(), 0.01);
    EXPECT_EQ(felt(renderer, device, kFresh).fault, fault);
    EXPECT_TRUE(felt(renderer, {}, kFresh).torque.isZero(0));
  }
  ForceRenderer stale{at_full_strength(), bearing(1)};
  EXPECT_GT(felt(stale, {}, kFresh).torque.norm(), 0.01);
  EXPECT_TRUE(felt(stale, {}, 0.06).torque.isZero(0));
}

}  // namespace
}  // namespace tactus::haptics
