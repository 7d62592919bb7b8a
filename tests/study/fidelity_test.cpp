#include "study/fidelity.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "study/true_hand.hpp"
#include "tests/study/figures.hpp"

namespace tactus::study {
namespace {

/// The fidelity of hands that move along x at 1 mm/ms and feel forces along z.
class HandMotion {
 public:
  /// Adds samples of `ms` ms with a felt and a true force, N.
  void add(int ms, double felt, double truth, bool exact = true) {
    for (int i = 0; i < ms; ++i)
      fidelity.add({1e-3 * samples_++, 0, 0}, {{0, 0, felt}, Vec3d::Zero()}, {{0, 0, truth}, Vec3d::Zero()}, exact);
  }
  [[nodiscard]] Figures figures() const { return fidelity.figures(); }
  Fidelity fidelity;

 private:
  int samples_ = 0;
};

TEST(Fidelity, HasNoErrorForEqualForces) {
  HandMotion hand;
  hand.add(100, 0, 0);
  hand.add(50, 2, 2);
  hand.add(100, 0, 0);
  const Figures figures = hand.figures();
  EXPECT_EQ(value_of(figures, "contact"), 0.05);
  EXPECT_EQ(value_of(figures, "force error rms"), 0);
  EXPECT_EQ(value_of(figures, "above 1 JND"), 0);
  EXPECT_EQ(value_of(figures, "touches"), 1);
  EXPECT_EQ(value_of(figures, "onset time error"), 0);
  EXPECT_EQ(value_of(figures, "peak force ratio"), 1);
  EXPECT_EQ(value_of(figures, "missed") + value_of(figures, "false"), 0);
}

TEST(Fidelity, ComparesErrorsWithTheJndOfTheTrueForce) {
  EXPECT_EQ(jnd_of(0), 0.05);
  EXPECT_EQ(jnd_of(5), 0.5);
  HandMotion hand;
  hand.add(30, 2.19, 2);  // 0.95 JND
  hand.add(10, 2.3, 2);   // 1.5 JND
  const Figures figures = hand.figures();
  EXPECT_NEAR(value_of(figures, "force error rms"), std::sqrt((30 * 0.19 * 0.19 + 10 * 0.3 * 0.3) / 40), 1e-12);
  EXPECT_NEAR(value_of(figures, "force error max"), 0.3, 1e-12);
  EXPECT_EQ(value_of(figures, "above 1 JND"), 25);
}

TEST(Fidelity, MeasuresDelayAndDistanceOfTouchOnsets) {
  HandMotion hand;
  hand.add(100, 0, 0);
  hand.add(7, 0, 1);
  hand.add(20, 1.5, 1);
  hand.add(50, 0, 0);
  hand.add(3, 1, 0);
  hand.add(20, 1, 2);
  const Figures figures = hand.figures();
  EXPECT_EQ(value_of(figures, "touches"), 2);
  EXPECT_EQ(value_of(figures, "onset time error"), 5);
  EXPECT_NEAR(value_of(figures, "onset position error"), 5, 1e-9);
  EXPECT_EQ(value_of(figures, "peak force ratio"), 1);  // the mean of 1.5 and 0.5
  EXPECT_EQ(value_of(figures, "missed") + value_of(figures, "false"), 0);
}

TEST(Fidelity, CountsMissedAndFalseTouches) {
  HandMotion hand;
  hand.add(20, 0, 1);  // missed
  hand.add(50, 0, 0);
  hand.add(20, 1, 0);  // false
  hand.add(50, 0, 0);
  hand.add(20, 1, 1);
  hand.add(10, 0, 0);  // a bounce, which does not end the touch
  hand.add(20, 1, 1);
  hand.add(30, 1, 0);  // the true force vanishes and the felt force stays: the touch continues
  hand.add(20, 1, 1);
  const Figures figures = hand.figures();
  EXPECT_EQ(value_of(figures, "touches"), 3);
  EXPECT_EQ(value_of(figures, "missed"), 1);
  EXPECT_EQ(value_of(figures, "false"), 1);
  EXPECT_EQ(value_of(figures, "onset time error"), 0);
}

TEST(Fidelity, WithoutAFeltTouchHasNoOnsetsAndNoPeakForces) {
  HandMotion hand;
  hand.add(20, 0, 1);
  const Figures figures = hand.figures();
  EXPECT_EQ(value_of(figures, "missed"), 1);
  for (const char* name : {"exact", "onset time error", "onset position error", "peak force ratio"})
    EXPECT_TRUE(std::isnan(value_of(figures, name))) << name;
}

TEST(Fidelity, WithoutContactHasNoErrors) {
  HandMotion hand;
  hand.add(20, 0.04, 0.04);
  const Figures figures = hand.figures(), torques = hand.fidelity.torque_figures();
  EXPECT_EQ(value_of(figures, "contact"), 0);
  EXPECT_EQ(value_of(figures, "touches"), 0);
  for (const char* name : {"force error rms", "force error max", "above 1 JND"})
    EXPECT_TRUE(std::isnan(value_of(figures, name))) << name;
  for (const Figure& figure : torques) EXPECT_TRUE(std::isnan(figure.value)) << figure.name;
}

TEST(Fidelity, FiguresHaveDifferentNames) {
  std::set<std::string> names;
  for (const Figure& figure : HandMotion{}.figures()) EXPECT_TRUE(names.insert(figure.name).second) << figure.name;
}

TEST(Fidelity, MeasuresTorqueErrorsOnlyInContact) {
  EXPECT_NEAR(torque_jnd_of(0), 0.00125, 1e-12);
  EXPECT_NEAR(torque_jnd_of(0.1), 0.013, 1e-12);
  Fidelity fidelity;
  const Vec3d zero = Vec3d::Zero(), force{0, 0, 1};
  for (int i = 0; i < 30; ++i) fidelity.add(zero, {force, {0, 0.112, 0}}, {force, {0, 0.1, 0}}, true);
  for (int i = 0; i < 10; ++i) fidelity.add(zero, {force, {0.02, 0.1, 0}}, {force, {0, 0.1, 0}}, true);
  for (int i = 0; i < 99; ++i) fidelity.add(zero, {zero, {0, 1, 0}}, {zero, zero}, true);  // no contact
  const Figures figures = fidelity.torque_figures();
  EXPECT_NEAR(value_of(figures, "torque error rms"), std::sqrt((30 * 12.0 * 12 + 10 * 20.0 * 20) / 40), 1e-9);
  EXPECT_NEAR(value_of(figures, "torque error max"), 20, 1e-9);
  EXPECT_EQ(value_of(figures, "torque above 1 JND"), 25);
  EXPECT_NEAR(value_of(figures, "true torque rms"), 100, 1e-9);
}

TEST(Fidelity, CountsTheTouchesOfEachHandSeparately) {
  HandMotion hand;
  hand.add(20, 1, 1);
  hand.fidelity.start_next_hand();
  hand.add(20, 1, 1);
  EXPECT_EQ(value_of(hand.figures(), "touches"), 2);
}

TEST(TrueSphere, OnABoxHasTheForceStiffnessTimesDepth) {
  haptics::BoxSurface box{{0.1, 0.1, 0.01}};
  haptics::ForceSettings settings;
  settings.soft_start = 0;
  const session::Material material;  // 1000 N/m
  TrueSphere truth{box, 0.003, material, settings};
  haptics::DeviceState device;
  device.position = {0, 0, 0.02};
  EXPECT_EQ(truth.at(device, false).force.norm(), 0);
  Vec3d force;
  for (int ms = 0; ms < 50; ++ms) {
    device.position.z() = std::max(0.012, 0.02 - 0.001 * ms);
    device.time_ns += 1'000'000;
    force = truth.at(device, false).force;
  }
  EXPECT_NEAR(force.z(), 1.0, 2e-3);  // 1 mm deep; the tolerance includes the micron by which a proxy stays outside
  EXPECT_NEAR(force.head<2>().norm(), 0, 1e-9);
}

}  // namespace
}  // namespace tactus::study
