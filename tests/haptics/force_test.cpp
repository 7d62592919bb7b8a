#include "haptics/force.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "haptics/rigid_body.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

constexpr unsigned kForceSeed = 20054;
constexpr double kFreshAge = 1e-4;  // s, of a pose

/// No soft start and no limit of the slew rate.
ForceSettings settings_without_ramps() {
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
  ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
  const Vec3d force = renderer.step(floor_contact(0.002), device_moving(-0.1), {1000, 2}, kFreshAge, kCycle).force;
  EXPECT_LT((force - Vec3d(0, 0, 2.0 + 0.2)).norm(), 1e-12);
}

TEST(Force, DampingNeverPullsTheHandBackToTheSurface) {
  ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
  const ForceResult result = renderer.step(floor_contact(0.0001), device_moving(0.5), {1000, 2}, kFreshAge, kCycle);
  EXPECT_GE(result.force.z(), 0);
}

TEST(Force, IsZeroInTheAirAtAnySpeed) {
  ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
  const ForceResult result = renderer.step(ProxyResult{}, device_moving(-0.5), {1000, 2}, kFreshAge, kCycle);
  EXPECT_EQ(result.force, Vec3d(Vec3d::Zero()));
  EXPECT_EQ(result.bits, 0u);
}

TEST(Force, SaturatesAtTheSmallerLimitOfSettingsAndDevice) {
  DeviceSpec weak;
  weak.max_force = 3;
  ForceRenderer renderer{settings_without_ramps(), weak};
  const ForceResult result = renderer.step(floor_contact(0.1), DeviceState{}, {1000, 0}, kFreshAge, kCycle);
  EXPECT_NEAR(result.force.norm(), 3, 1e-12);
  EXPECT_TRUE(result.bits & kForceSaturated);
}

TEST(Force, LatchesZeroWhenALimitIsNaN) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  ForceSettings force = settings_without_ramps(), slew = settings_without_ramps();
  force.max_force = kNan;
  slew.max_slew = kNan;
  for (const ForceSettings& settings : {force, slew}) {
    ForceRenderer renderer{settings, DeviceSpec{}};
    const ForceResult result = renderer.step(floor_contact(0.1), DeviceState{}, {1000, 0}, kFreshAge, kCycle);
    EXPECT_EQ(result.fault, Fault::kForceNotFinite);
    EXPECT_EQ(result.force, Vec3d(Vec3d::Zero()));
  }
}

TEST(Force, StartsSoftly) {
  ForceSettings settings;
  ForceRenderer renderer{settings, DeviceSpec{}};
  double last_force = 0;
  for (int i = 1; i <= 500; ++i) {
    const ForceResult& result = renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFreshAge, kCycle);
    ASSERT_NEAR(result.force.z(), 2.0 * i * kCycle / settings.soft_start, 1e-9);
    ASSERT_EQ((result.bits & kForceSoftStart) != 0, i < 500) << i;
    ASSERT_GT(result.force.z(), last_force);
    last_force = result.force.z();
  }
}

TEST(Force, IsHeldAndThenFadesToZeroForAStalePose) {
  ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
  (void)renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle);
  double last_force = 2;
  for (int ms = 1; ms <= 100; ++ms) {
    const ForceResult& result = renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, ms * kCycle, kCycle);
    if (ms <= 10) {
      ASSERT_NEAR(result.force.z(), 2, 1e-9) << ms;
    }
    if (ms > 10 && ms < 60) {
      ASSERT_LT(result.force.z(), last_force) << ms;
    }
    if (ms >= 60) {
      ASSERT_EQ(result.force, Vec3d(Vec3d::Zero())) << ms;
    }
    ASSERT_EQ((result.bits & kForceStale) != 0, ms > 10) << ms;
    last_force = result.force.z();
  }
  // With fresh poses the force returns over the recovery time.
  EXPECT_LT(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle).force.z(), 0.1);
  for (int i = 0; i < 100; ++i) (void)renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle);
  EXPECT_NEAR(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, 0, kCycle).force.z(), 2, 1e-9);
}

TEST(Force, LatchesZeroWhenAnyInputIsNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (int input = 0; input < 6; ++input) {
    ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
    ProxyResult proxy = floor_contact(0.002);
    DeviceState device;
    ContactImpedance impedance{1000, 1};
    double age = kFreshAge;
    if (input == 0) proxy.anchor.x() = nan;
    if (input == 1) proxy.normal.y() = infinity;
    if (input == 2) device.position.z() = nan;
    if (input == 3) device.velocity.x() = infinity;
    if (input == 4) impedance.stiffness = nan;
    if (input == 5) age = nan;
    (void)renderer.step(proxy, device, impedance, age, kCycle);
    for (int i = 0; i < 5; ++i) {
      const ForceResult& result = renderer.step(floor_contact(0.002), DeviceState{}, {1000, 1}, kFreshAge, kCycle);
      ASSERT_EQ(result.force, Vec3d(Vec3d::Zero())) << input;
      ASSERT_EQ(result.fault, Fault::kInputNotFinite) << input;
      ASSERT_TRUE(result.bits & kForceFault) << input;
    }
    renderer.reset();
    EXPECT_GT(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 1}, kFreshAge, kCycle).force.z(), 1);
  }
}

TEST(Force, ReportsTheFirstFaultUntilReset) {
  ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
  renderer.latch(Fault::kEmergencyStop);
  renderer.latch(Fault::kDeviceFailed);
  EXPECT_EQ(renderer.step(floor_contact(1), DeviceState{}, {}, kFreshAge, kCycle).fault, Fault::kEmergencyStop);
}

TEST(Force, LatchesAFaultAtExcessSpeedOnlyWhileAForceActs) {
  ForceSettings settings = settings_without_ramps();
  DeviceState fast = device_moving(0);
  fast.velocity = {settings.max_speed + 0.1, 0, 0};
  ForceRenderer by_velocity{settings, DeviceSpec{}};
  EXPECT_EQ(by_velocity.step(ProxyResult{}, fast, {1000, 0}, kFreshAge, kCycle).fault, Fault::kNone);
  EXPECT_EQ(by_velocity.step(floor_contact(0.002), fast, {1000, 0}, kFreshAge, kCycle).fault, Fault::kNone);
  const ForceResult& result = by_velocity.step(floor_contact(0.002), fast, {1000, 0}, kFreshAge, kCycle);
  EXPECT_EQ(result.fault, Fault::kTooFast);
  EXPECT_EQ(result.force, Vec3d(Vec3d::Zero()));

  // A device that reports zero velocity while its positions jump.
  ForceRenderer by_position{settings, DeviceSpec{}};
  DeviceState jumping;
  EXPECT_EQ(by_position.step(floor_contact(0.002), jumping, {1000, 0}, kFreshAge, kCycle).fault, Fault::kNone);
  jumping.position.x() += (settings.max_speed + 0.1) * kCycle;
  EXPECT_EQ(by_position.step(floor_contact(0.002), jumping, {1000, 0}, kFreshAge, kCycle).fault, Fault::kTooFast);
}

TEST(Force, AllowsALargerDistanceAfterALatePose) {
  ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
  DeviceState device;
  (void)renderer.step(floor_contact(0.002), device, {1000, 0}, kFreshAge, kCycle);
  device.position.x() += 0.01;
  device.time_ns += 20'000'000;
  EXPECT_EQ(renderer.step(floor_contact(0.002), device, {1000, 0}, kFreshAge, kCycle).fault, Fault::kNone);
}

TEST(Force, ReportsEachStatusBitOnceWhenItIsSet) {
  ForceSettings settings = settings_without_ramps();
  settings.max_force = 1;
  ForceRenderer renderer{settings, DeviceSpec{}};
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFreshAge, kCycle).began, kForceSaturated);
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFreshAge, kCycle).began, 0u);
  renderer.latch(Fault::kEmergencyStop);
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFreshAge, kCycle).began, kForceFault);
  EXPECT_EQ(renderer.step(floor_contact(0.002), DeviceState{}, {1000, 0}, kFreshAge, kCycle).began, 0u);
}

TEST(Force, CutsAStiffnessThatTheDeviceCannotRenderStably) {
  ForceSettings settings = settings_without_ramps();
  settings.max_force = 1e9;
  DeviceSpec spec;
  spec.damping = 1;
  spec.max_force = 1e9;
  ForceRenderer renderer{settings, spec};
  const ForceResult result = renderer.step(floor_contact(0.001), DeviceState{}, {10000, 0}, kFreshAge, kCycle);
  EXPECT_NEAR(result.force.z(), 2.0, 1e-9);  // limit: 1 N s/m / 0.5 ms (half a cycle) = 2000 N/m
  EXPECT_TRUE(result.bits & kForceStiffnessCut);
  EXPECT_NEAR(stable_stiffness(5, 0, 1e-3, 0.020), 244, 0.5);  // from Hulin's rule for a delay of 20 ms
}

TEST(Force, TheDampingOfAMaterialIsLimitedToAStableOne) {
  constexpr double kMass = 0.1;  // kg, of the lightest device
  for (const double round_trip : {0.0, 0.01, 0.2}) {
    const ContactImpedance limited = ForceRenderer::with_stable_damping({5000, 1000}, kCycle, round_trip);
    EXPECT_EQ(limited.stiffness, 5000);
    EXPECT_LT(limited.damping, 2 * kMass / kCycle) << "as a sampled damper";
    EXPECT_LT(limited.damping * round_trip, EIGEN_PI / 2 * kMass) << "as a delayed damper";
  }
  constexpr double kDelay = 0.2;  // s
  const ContactImpedance limited = ForceRenderer::with_stable_damping({5000, 1000}, kCycle, kDelay);
  const ForceRenderer renderer{ForceSettings{}, DeviceSpec{}};
  EXPECT_LT(renderer.stiffness(limited, kCycle, kDelay), 20) << "the damping permits no stiff spring";
  for (const double damping : {0.0, 1.0, 3.0})
    EXPECT_EQ(ForceRenderer::with_stable_damping({1000, damping}, kCycle, 0.02).damping, damping) << "usual materials";
}

TEST(Force, MarksTheRampOfASurfaceThatMoved) {
  ForceRenderer renderer{settings_without_ramps(), DeviceSpec{}};
  const ProxyResult upper = floor_contact(0.001), lower = floor_contact(0.0009);
  EXPECT_FALSE(renderer.step(lower, DeviceState{}, {1000, 0}, kFreshAge, kCycle).bits & kForceSurfaceRamp);
  EXPECT_TRUE(renderer.step(upper, DeviceState{}, {1000, 0}, kFreshAge, kCycle, &lower).bits & kForceSurfaceRamp);
  for (int i = 0; i < 2; ++i)  // 0.1 N at 45 N/s
    EXPECT_TRUE(renderer.step(upper, DeviceState{}, {1000, 0}, kFreshAge, kCycle).bits & kForceSurfaceRamp);
  EXPECT_FALSE(renderer.step(upper, DeviceState{}, {1000, 0}, kFreshAge, kCycle).bits & kForceSurfaceRamp);
}

TEST(Force, KeepsItsLimitsForAnyInput) {
  std::mt19937 random{kForceSeed};
  const auto random_number = [&] {
    const double absolute = std::pow(10, std::uniform_real_distribution<double>{-6, 6}(random));
    const double choice = std::uniform_real_distribution<double>{0, 1}(random);
    if (choice < 0.0005) return std::numeric_limits<double>::quiet_NaN();
    return choice < 0.5 ? -absolute : absolute;
  };
  const ForceSettings settings;
  ForceRenderer renderer{settings, DeviceSpec{}};
  Vec3d last_force = Vec3d::Zero();
  for (int i = 0; i < 200000; ++i) {
    ProxyResult proxy;
    proxy.anchor = {random_number(), random_number(), random_number()};
    proxy.in_contact = i % 3 != 0;
    proxy.normal = Vec3d{random_number(), random_number(), random_number()}.normalized();
    DeviceState device;
    device.position = {random_number(), random_number(), random_number()};
    device.velocity = {random_number(), random_number(), random_number()};
    const double age = std::abs(random_number()) * 1e-3;
    ProxyResult unchanged = proxy;
    if (i % 5 == 0) unchanged.anchor = {random_number(), random_number(), random_number()};
    const ForceResult& result = renderer.step(proxy, device, {std::abs(random_number()), std::abs(random_number())},
                                              age, kCycle, i % 5 == 0 ? &unchanged : nullptr);
    ASSERT_TRUE(result.force.allFinite()) << "seed " << kForceSeed << " step " << i;
    ASSERT_LE(result.force.norm(), settings.max_force + 1e-9) << "seed " << kForceSeed << " step " << i;
    if (age >= settings.zero_force_age) {
      ASSERT_EQ(result.force, Vec3d(Vec3d::Zero()));
    }
    if (!result.force.isZero(0)) {
      ASSERT_LE((result.force - last_force).norm(), settings.max_slew * kCycle + 1e-9)
          << "seed " << kForceSeed << " step " << i;
    }
    last_force = result.force;
    if (result.fault != Fault::kNone) renderer.reset();
  }
}

ToolResult pressed_tool(double depth, double angle) {
  ToolResult tool;
  tool.in_contact = true;
  tool.displacement = {0, 0, depth};
  tool.rotation = {angle, 0, 0};
  return tool;
}

DeviceSpec device_with_torque(double torque) {
  DeviceSpec spec;
  spec.max_torque = torque;
  return spec;
}

TEST(Force, OfAToolIsTheWrenchOfItsCoupling) {
  ForceSettings settings = settings_without_ramps();
  settings.max_torque_slew = 1e9;
  ForceRenderer renderer{settings, device_with_torque(1)};
  const ContactImpedance impedance{1000, 0};
  const ToolGrip grip = renderer.tool_grip(impedance, kCycle);
  EXPECT_EQ(grip.stiffness, 1000);
  EXPECT_NEAR(grip.rotational_stiffness, 0.1, 1e-15);
  const ForceResult& result =
      renderer.step(pressed_tool(0.002, 0.5), grip, DeviceState{}, impedance, kFreshAge, kCycle);
  EXPECT_LT((result.force - Vec3d(0, 0, 2)).norm(), 1e-12);
  EXPECT_LT((result.torque - Vec3d(0.05, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(result.bits, 0u);
}

/// Rotates a device without damping against a held tool and returns the amplitude of its oscillation after 1 s, rad.
/// The inertia of the device is 10^-4 kg m^2. `damping_factor` scales the angular damping of the grip.
double amplitude_after_1_s(double damping_factor) {
  ForceSettings settings = settings_without_ramps();
  ForceRenderer renderer{settings, device_with_torque(1)};
  const ContactImpedance impedance{1000, 0};
  ToolGrip grip = renderer.tool_grip(impedance, kCycle);
  grip.angular_damping *= damping_factor;
  double angle = 0.2, angular_velocity = 0, amplitude = 0;
  for (int i = 0; i < 1200; ++i) {
    DeviceState device;
    device.orientation = exp_map({angle, 0, 0});
    device.time_ns = 1'000'000 * i;
    const Vec3d torque = renderer.step(pressed_tool(0.001, -angle), grip, device, impedance, kFreshAge, kCycle).torque;
    angular_velocity += kCycle * torque.x() / 1e-4;
    angle += kCycle * angular_velocity;
    if (i >= 1000) amplitude = std::max(amplitude, std::abs(angle));
  }
  return amplitude;
}

TEST(Force, ADeviceRotatedAgainstAToolComesToRest) {
  EXPECT_GT(amplitude_after_1_s(0), 0.15);
  EXPECT_LT(amplitude_after_1_s(1), 0.02);
}

TEST(Force, OfAHoldActsInSixDegreesOfFreedomAndDampsRelativeMotion) {
  ForceSettings settings = settings_without_ramps();
  settings.max_torque_slew = 1e9;
  ForceRenderer renderer{settings, device_with_torque(1)}, weak{settings, device_with_torque(0)};
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
  const ForceResult& result = renderer.step(hold, grip, device, impedance, kFreshAge, kCycle);
  EXPECT_LT((result.force - Vec3d(1, 0.3, -2.6)).norm(), 1e-12);
  EXPECT_LT((result.torque - Vec3d(0, 0.1, 0.02)).norm(), 1e-12);
  EXPECT_EQ(result.bits, 0u);
  EXPECT_TRUE(weak.step(hold, grip, device, impedance, kFreshAge, kCycle).torque.isZero(0));
  hold.pose.position.x() = 1;
  EXPECT_NEAR(renderer.step(hold, grip, device, impedance, kFreshAge, kCycle).force.norm(), settings.max_force, 1e-9);
  hold.angular_velocity.x() = std::nan("");
  EXPECT_EQ(renderer.step(hold, grip, device, impedance, kFreshAge, kCycle).fault, Fault::kInputNotFinite);
  EXPECT_TRUE(renderer.step(Hold{}, grip, device, impedance, kFreshAge, kCycle).force.isZero(0));
}

TEST(Force, LimitsTheTorqueAndItsRateAndSendsNoneToAForceOnlyDevice) {
  ForceSettings settings = settings_without_ramps();
  settings.max_torque = 0.08;
  settings.max_torque_slew = 20;
  const ContactImpedance impedance{1000, 0};
  ForceRenderer renderer{settings, device_with_torque(1)}, weak{settings, device_with_torque(0.05)},
      none{settings, device_with_torque(0)};
  const ToolGrip grip = renderer.tool_grip(impedance, kCycle);
  const ToolResult tool = pressed_tool(0, 2);
  EXPECT_NEAR(renderer.step(tool, grip, {}, impedance, kFreshAge, kCycle).torque.norm(), 0.02, 1e-12);
  EXPECT_NE(renderer.step(tool, grip, {}, impedance, kFreshAge, kCycle).bits & kForceSlewLimited, 0u);
  for (int i = 0; i < 10; ++i) {
    static_cast<void>(renderer.step(tool, grip, {}, impedance, kFreshAge, kCycle));
    static_cast<void>(weak.step(tool, grip, {}, impedance, kFreshAge, kCycle));
  }
  const ForceResult& result = renderer.step(tool, grip, {}, impedance, kFreshAge, kCycle);
  EXPECT_NEAR(result.torque.norm(), 0.08, 1e-12);
  EXPECT_EQ(result.bits, std::uint32_t{kForceSaturated});
  EXPECT_NEAR(weak.step(tool, grip, {}, impedance, kFreshAge, kCycle).torque.norm(), 0.05, 1e-12);
  EXPECT_TRUE(none.step(tool, grip, {}, impedance, kFreshAge, kCycle).torque.isZero(0));
  EXPECT_EQ(none.step(tool, grip, {}, impedance, kFreshAge, kCycle).bits, 0u);
}

TEST(Force, ChangesByAtMost5000NewtonAndItsTorqueByAtMost150NewtonMetresASecond) {
  ForceSettings settings;
  settings.soft_start = 0;
  settings.max_torque = 10;
  ForceRenderer renderer{settings, device_with_torque(10)};
  const ContactImpedance impedance{1000, 0};
  const ToolGrip grip = renderer.tool_grip(impedance, kCycle);
  const ForceResult& result = renderer.step(pressed_tool(0.02, 3), grip, {}, impedance, kFreshAge, kCycle);
  EXPECT_NEAR(result.force.norm(), 5000 * kCycle, 1e-9);
  EXPECT_NEAR(result.torque.norm(), 150 * kCycle, 1e-9);
}

TEST(Force, AFaultEndsATorqueAndAFastRotationDuringATorqueIsAFault) {
  const ContactImpedance impedance{1000, 0};
  const auto render = [&](ForceRenderer& renderer, const DeviceState& device, double pose_age) -> const ForceResult& {
    return renderer.step(pressed_tool(0, 0.5), renderer.tool_grip(impedance, kCycle), device, impedance, pose_age,
                         kCycle);
  };
  DeviceState rotated;
  rotated.orientation = exp_map({0, 0, 0.1});  // in a millisecond
  rotated.time_ns = 1'000'000;
  DeviceState invalid;
  invalid.orientation.coeffs().setZero();
  for (const auto& [device, fault] :
       {std::pair{rotated, Fault::kTooFast}, std::pair{invalid, Fault::kInputNotFinite}}) {
    ForceRenderer renderer{settings_without_ramps(), device_with_torque(1)};
    EXPECT_GT(render(renderer, {}, kFreshAge).torque.norm(), 0.01);
    EXPECT_EQ(render(renderer, device, kFreshAge).fault, fault);
    EXPECT_TRUE(render(renderer, {}, kFreshAge).torque.isZero(0));
  }
  ForceRenderer stale{settings_without_ramps(), device_with_torque(1)};
  EXPECT_GT(render(stale, {}, kFreshAge).torque.norm(), 0.01);
  EXPECT_TRUE(render(stale, {}, 0.06).torque.isZero(0));
}

}  // namespace
}  // namespace tactus::haptics
