#include "study/fidelity.hpp"

#include <gtest/gtest.h>

#include "study/true_hand.hpp"

namespace tactus::study {
namespace {

double value_of(const Figures& figures, const std::string& name, const std::string& unit = "") {
  for (const Figure& figure : figures)
    if (figure.name == name && (unit.empty() || figure.unit == unit)) return figure.value;
  ADD_FAILURE() << name;
  return -1;
}

/// Hands that move along x at 1 mm/ms, with forces along z.
class Hand {
 public:
  void feel(int ms, double felt, double truth, bool exact = true) {
    for (int i = 0; i < ms; ++i)
      fidelity.add({1e-3 * at_++, 0, 0}, {{0, 0, felt}, Vec3d::Zero()}, {{0, 0, truth}, Vec3d::Zero()}, exact);
  }
  [[nodiscard]] Figures figures() const { return fidelity.figures(); }
  Fidelity fidelity;

 private:
  int at_ = 0;
};

TEST(Fidelity, OfEqualForcesIsPerfect) {
  Hand hand;
  hand.feel(100, 0, 0);
  hand.feel(50, 2, 2);
  hand.feel(100, 0, 0);
  const Figures figures = hand.figures();
  EXPECT_EQ(value_of(figures, "contact"), 0.05);
  EXPECT_EQ(value_of(figures, "force error rms"), 0);
  EXPECT_EQ(value_of(figures, "above 1 JND"), 0);
  EXPECT_EQ(value_of(figures, "touches"), 1);
  EXPECT_EQ(value_of(figures, "onset error", "ms"), 0);
  EXPECT_EQ(value_of(figures, "peak force ratio"), 1);
  EXPECT_EQ(value_of(figures, "missed") + value_of(figures, "false"), 0);
}

TEST(Fidelity, JudgesErrorsByTheForceTheyComeWith) {
  EXPECT_EQ(jnd_of(0), 0.05);
  EXPECT_EQ(jnd_of(5), 0.5);
  Hand hand;
  hand.feel(30, 2.19, 2);  // 0.95 JND
  hand.feel(10, 2.3, 2);   // 1.5 JND
  const Figures figures = hand.figures();
  EXPECT_NEAR(value_of(figures, "force error rms"), std::sqrt((30 * 0.19 * 0.19 + 10 * 0.3 * 0.3) / 40), 1e-12);
  EXPECT_NEAR(value_of(figures, "force error max"), 0.3, 1e-12);
  EXPECT_EQ(value_of(figures, "above 1 JND"), 25);
}

TEST(Fidelity, MeasuresDelayAndDistanceOfOnsets) {
  Hand hand;
  hand.feel(100, 0, 0);
  hand.feel(7, 0, 1);
  hand.feel(20, 1.5, 1);
  hand.feel(50, 0, 0);
  hand.feel(3, 1, 0);
  hand.feel(20, 1, 2);
  const Figures figures = hand.figures();
  EXPECT_EQ(value_of(figures, "touches"), 2);
  EXPECT_EQ(value_of(figures, "onset error", "ms"), 5);
  EXPECT_NEAR(value_of(figures, "onset error", "mm"), 5, 1e-9);
  EXPECT_EQ(value_of(figures, "peak force ratio"), 1);  // of 1.5 and 0.5
  EXPECT_EQ(value_of(figures, "missed") + value_of(figures, "false"), 0);
}

TEST(Fidelity, CountsMissedAndFalseTouches) {
  Hand hand;
  hand.feel(20, 0, 1);  // missed
  hand.feel(50, 0, 0);
  hand.feel(20, 1, 0);  // false
  hand.feel(50, 0, 0);
  hand.feel(20, 1, 1);
  hand.feel(10, 0, 0);  // a bounce, not an end
  hand.feel(20, 1, 1);
  hand.feel(30, 1, 0);  // the surface leaves for a while, the force on the hand stays: one continued touch
  hand.feel(20, 1, 1);
  const Figures figures = hand.figures();
  EXPECT_EQ(value_of(figures, "touches"), 3);
  EXPECT_EQ(value_of(figures, "missed"), 1);
  EXPECT_EQ(value_of(figures, "false"), 1);
  EXPECT_EQ(value_of(figures, "onset error", "ms"), 0);
}

TEST(Fidelity, JudgesTorquesWhileForcesAreFelt) {
  EXPECT_NEAR(torque_jnd_of(0), 0.00125, 1e-12);
  EXPECT_NEAR(torque_jnd_of(0.1), 0.013, 1e-12);
  Fidelity fidelity;
  const Vec3d here = Vec3d::Zero(), force{0, 0, 1};
  for (int i = 0; i < 30; ++i) fidelity.add(here, {force, {0, 0.112, 0}}, {force, {0, 0.1, 0}}, true);
  for (int i = 0; i < 10; ++i) fidelity.add(here, {force, {0.02, 0.1, 0}}, {force, {0, 0.1, 0}}, true);
  for (int i = 0; i < 99; ++i) fidelity.add(here, {here, {0, 1, 0}}, {here, here}, true);  // in the air
  const Figures figures = fidelity.torque_figures();
  EXPECT_NEAR(value_of(figures, "torque error rms"), std::sqrt((30 * 12.0 * 12 + 10 * 20.0 * 20) / 40), 1e-9);
  EXPECT_NEAR(value_of(figures, "torque error max"), 20, 1e-9);
  EXPECT_EQ(value_of(figures, "torque above 1 JND"), 25);
  EXPECT_NEAR(value_of(figures, "true torque rms"), 100, 1e-9);
}

TEST(Fidelity, KeepsHandsApart) {
  Hand hand;
  hand.feel(20, 1, 1);
  hand.fidelity.start_next_hand();
  hand.feel(20, 1, 1);
  EXPECT_EQ(value_of(hand.figures(), "touches"), 2);
}

TEST(TrueSphere, OnABoxIsStiffnessTimesDepth) {
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
  EXPECT_NEAR(force.z(), 1.0, 2e-3);  // 1 mm below the lowest position of the 3 mm sphere, plus a micron of proxy skin
  EXPECT_NEAR(force.head<2>().norm(), 0, 1e-9);
}

}  // namespace
}  // namespace tactus::study
