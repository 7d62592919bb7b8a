#include "haptics/coupling.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <memory>
#include <random>
#include <vector>

#include "haptics/shared_object.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

constexpr std::int64_t kCycleNs = 1'000'000;

BodySettings floating_box(double mass) {
  BodySettings settings = box_body(mass, {0.05, 0.05, 0.05});
  settings.gravity.setZero();
  return settings;
}

/// Copies of a box, and a network that delays, loses and duplicates samples.
class Copies {
 public:
  struct Network {
    double delay_ms = 20;
    double spread_ms = 0;    ///< maximum of a random additional delay, with which samples overtake each other
    double loss = 0;         ///< probability
    double duplication = 0;  ///< probability
  };

  Copies(std::size_t count, CouplingSettings settings, const BodySettings& body, const Network& network, unsigned seed)
      : network_{network}, random_{seed} {
    settings.copies = count;
    for (std::size_t i = 0; i < count; ++i) {
      objects_.push_back(std::make_unique<SharedObject>(body));
      couplings_.push_back(std::make_unique<CopyCoupling>(settings, i, body));
      objects_.back()->couple(*couplings_.back());
    }
  }

  /// `forces`: one per copy, N. `lever`: torque for each newton, m. `hands`: one per copy, or empty.
  void step(const std::vector<Vec3d>& forces, double lever = 0, const std::vector<PointSpring>& hands = {}) {
    for (std::size_t i = 0; i < in_flight_.size();) {
      if (in_flight_[i].arrival_ns > now_ns_) {
        ++i;
        continue;
      }
      objects_[in_flight_[i].to]->coupling()->on_sample(in_flight_[i].from, in_flight_[i].sample);
      in_flight_.erase(in_flight_.begin() + static_cast<long>(i));
    }
    Surroundings no_surroundings;
    no_surroundings.ground = false;
    for (std::size_t i = 0; i < objects_.size(); ++i) {
      ImplicitForce force;
      force.impulse.head<3>() = kCycle * forces[i];
      force.impulse.tail<3>() = kCycle * lever * forces[i].reverse();
      objects_[i]->step(now_ns_, {hands.data() + (hands.empty() ? 0 : i), hands.empty() ? 0u : 1u}, no_surroundings,
                        kCycle, &force);
      for (std::size_t receiver = 0; receiver < objects_.size(); ++receiver) {
        if (receiver == i || uniform() < network_.loss) continue;
        for (int packets = uniform() < network_.duplication ? 2 : 1; packets > 0; --packets) {
          const double delay_ms = network_.delay_ms + network_.spread_ms * uniform();
          in_flight_.push_back(
              {now_ns_ + static_cast<std::int64_t>(delay_ms * 1e6), i, receiver, objects_[i]->coupling()->sample()});
        }
      }
    }
    now_ns_ += kCycleNs;
  }

  [[nodiscard]] SharedObject& operator[](std::size_t i) { return *objects_[i]; }
  /// Energy given to all copies minus energy taken from them, J.
  [[nodiscard]] double given() {
    double sum = 0;
    for (const auto& object : objects_) sum += object->coupling()->ledger().given;
    return sum;
  }
  double uniform() { return std::uniform_real_distribution<double>{0, 1}(random_); }

 private:
  struct Packet {
    std::int64_t arrival_ns;
    std::size_t from, to;
    CopySample sample;
  };
  Network network_;
  std::mt19937 random_;
  std::vector<std::unique_ptr<CopyCoupling>> couplings_;
  std::vector<std::unique_ptr<SharedObject>> objects_;
  std::deque<Packet> in_flight_;
  std::int64_t now_ns_ = kCycleNs;
};

TEST(Coupling, CopiesAccelerateAsOneBodyOfTheWholeMass) {
  for (const std::size_t count : {2u, 3u, 5u}) {
    CouplingSettings settings;
    settings.delay = 0.021;
    settings.drag = 0;
    settings.min_stiffness = 0;
    Copies copies{count, settings, floating_box(1), {}, 1};
    std::vector<Vec3d> forces(count, Vec3d::Zero());
    // The waves take 0.2 s to spread. During the next second, the velocity grows by F / m times 1 s.
    forces[0] = {0.3, 0, 0};
    for (int i = 0; i < 200; ++i) copies.step(forces);
    const double start_velocity = copies[0].state().velocity.x();
    for (int i = 0; i < 1000; ++i) copies.step(forces);
    EXPECT_NEAR(copies[0].state().velocity.x() - start_velocity, 0.3, 0.04) << count << " copies";
    for (std::size_t i = 1; i < count; ++i)
      EXPECT_NEAR(copies[i].state().velocity.x(), copies[0].state().velocity.x(), 0.06) << count << " copies";
  }
}

TEST(Coupling, ReturnsAtMostTheEnergyPutInForAnyNetwork) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    std::mt19937 random{seed};
    std::uniform_real_distribution<double> uniform{0, 1};
    Copies::Network network;
    network.delay_ms = 150 * uniform(random);
    network.spread_ms = 100 * uniform(random);
    network.loss = 0.4 * uniform(random);
    network.duplication = 0.3 * uniform(random);
    CouplingSettings settings;
    settings.delay = 0.2 * uniform(random) + 0.002;  // may differ from the delay of the network
    settings.stiffness = 100 + 3000 * uniform(random);
    const std::size_t count = 2 + seed % 4;
    Copies copies{count, settings, floating_box(0.2 + uniform(random)), network, seed};
    std::vector<Vec3d> forces(count);
    double max_excess = 0;
    for (int i = 0; i < 3000; ++i) {
      if (i % 97 == 0) {
        for (Vec3d& force : forces)
          force = 4 * Vec3d{uniform(random) - 0.5, uniform(random) - 0.5, uniform(random) - 0.5};
      }
      copies.step(forces, 0.002);
      max_excess = std::max(max_excess, copies.given() - settings.initial_energy - settings.allowance * i * kCycle);
      for (std::size_t k = 0; k < count; ++k) {
        ASSERT_GE(copies[k].coupling()->ledger().tank, 0) << "seed " << seed;
        ASSERT_TRUE(copies[k].state().position.allFinite()) << "seed " << seed;
      }
    }
    EXPECT_LE(max_excess, 1e-12) << "seed " << seed;
  }
}

TEST(Coupling, WavesWithoutEnergyMoveNothing) {
  // The peer sends waves, but its energy counter states that it has put no energy into the channel.
  CouplingSettings settings;
  settings.allowance = settings.initial_energy = 0;
  settings.delay = 0.01;
  SharedObject object{floating_box(0.5)};
  CopyCoupling coupling{settings, 0, object.body().settings()};
  object.couple(coupling);
  Surroundings no_surroundings;
  no_surroundings.ground = false;
  for (int i = 1; i <= 2000; ++i) {
    CopySample sample;
    sample.time_ns = i * kCycleNs;
    sample.body = object.state();
    sample.waves[0].setConstant(0.1 * std::sin(0.05 * i));
    object.coupling()->on_sample(1, sample);
    object.step(i * kCycleNs, {}, no_surroundings, kCycle);
  }
  EXPECT_EQ(object.state().velocity.norm(), 0);
  EXPECT_GT(object.coupling()->ledger().limited_cycles, 1500u);
}

/// Distances are between the two copies, along the direction of the pressing.
struct SqueezeResult {
  double max_distance = 0;    ///< m
  double early_distance = 0;  ///< m, 1 s after the full force
  double late_distance = 0;   ///< m, 4 s later
  double sideways_speed = 0;  ///< m/s, gained from 0.3 N in the last second
  double given = 0;           ///< J, maximum of Copies::given
};
/// Two users press a box from both sides with up to `force` N each, over a one-way delay of 60 ms. Then a force acts
/// sideways.
SqueezeResult squeeze(const CouplingSettings& settings, double force) {
  constexpr double kHandStiffness = 200;  // N/m
  constexpr double kRampCycles = 500;
  Copies copies{2, settings, floating_box(0.5), {60, 5, 0.01, 0}, 3};
  SqueezeResult result;
  std::vector<Vec3d> forces(2, Vec3d::Zero());
  for (int i = 0; i < 7500; ++i) {
    // A light touch for 1 s, then a ramp to the full force.
    const double depth = force / kHandStiffness * std::clamp((i - 1000) / kRampCycles, 0.1, 1.0);
    std::vector<PointSpring> hands(2);
    for (std::size_t k = 0; k < 2; ++k) {
      hands[k].point = copies[k].state().position;
      hands[k].target = hands[k].point;  // free sideways
      hands[k].target.x() = k == 0 ? depth : -depth;
      hands[k].target_velocity = copies[k].state().velocity;
      hands[k].target_velocity.x() = 0;
      hands[k].stiffness = kHandStiffness;
      hands[k].damping = 5;
    }
    if (i == 6500) forces[0] = forces[1] = {0, 0.15, 0};
    copies.step(forces, 0, hands);
    const double distance = copies[0].state().position.x() - copies[1].state().position.x();
    result.max_distance = std::max(result.max_distance, distance);
    if (i == 2500) result.early_distance = distance;
    if (i == 6499) result.late_distance = distance;
    result.given = std::max(result.given, copies.given());
  }
  result.sideways_speed = copies[0].state().velocity.y();
  return result;
}

TEST(Coupling, CopiesPressedFromBothSidesStayTogether) {
  CouplingSettings settings;
  settings.delay = 0.075;
  const SqueezeResult pressed = squeeze(settings, 6);
  EXPECT_LT(pressed.late_distance, pressed.early_distance + 0.0015) << "the distance does not grow steadily";
  EXPECT_LE(pressed.given, settings.initial_energy);
  settings.stretch = 1;  // so large that opposing forces do not change the coupling
  EXPECT_LT(pressed.max_distance, 0.8 * squeeze(settings, 6).max_distance);
}

TEST(Coupling, AnObjectPressedFromBothSidesStillMovesSideways) {
  CouplingSettings settings;
  settings.delay = 0.075;
  const double free_speed = squeeze(settings, 0).sideways_speed;
  EXPECT_GT(free_speed, 0.25);
  // In the direction of the pressing, the object has ten times its mass.
  EXPECT_GT(squeeze(settings, 6).sideways_speed, 0.6 * free_speed);
}

TEST(Coupling, CopiesThatStartApartConverge) {
  CouplingSettings settings;
  settings.delay = 0.021;
  settings.allowance = 1e-3;
  const Copies::Network network;
  Copies copies{2, settings, floating_box(0.5), network, 1};
  BodyState moved;
  moved.position = {0.004, 0, 0.002};
  moved.orientation = exp_map({0, 0.05, 0});
  copies[1].set_state(moved);
  for (int i = 0; i < 5000; ++i) copies.step(std::vector<Vec3d>(2, Vec3d::Zero()));
  EXPECT_LT((copies[0].state().position - copies[1].state().position).norm(), 5e-4);
  EXPECT_LT(log_map(copies[0].state().orientation.conjugate() * copies[1].state().orientation).norm(), 5e-3);
}

/// Divides a moving object into copies and returns the maximum change of a copy's velocity, m/s: in the first second,
/// and in the second half of this second.
std::array<double, 2> velocity_changes_after_division(std::size_t count, const Vec3d& angular_velocity) {
  CouplingSettings settings;
  settings.delay = 0.03;
  settings.drag = 0;
  Copies copies{count, settings, floating_box(0.5), {}, 1};
  BodyState moving;
  moving.velocity = {0.2, 0, -0.1};
  moving.angular_velocity = angular_velocity;
  for (std::size_t i = 0; i < count; ++i) copies[i].set_state(moving);
  std::array<double, 2> changes{};
  for (int i = 0; i < 1000; ++i) {
    copies.step(std::vector<Vec3d>(count, Vec3d::Zero()));
    for (std::size_t k = 0; k < count; ++k) {
      const double change = (copies[k].state().velocity - moving.velocity).norm();
      changes[0] = std::max(changes[0], change);
      if (i >= 500) changes[1] = std::max(changes[1], change);
    }
  }
  return changes;
}

TEST(Coupling, AMovingObjectKeepsItsVelocityWhenItIsDividedIntoCopies) {
  for (const std::size_t count : {2u, 4u}) {
    SCOPED_TRACE(count);
    EXPECT_LT(velocity_changes_after_division(count, Vec3d::Zero())[0], 0.04);
    // Channels that carry rotation use the tank's energy until the peers' first waves arrive.
    const std::array<double, 2> rotating = velocity_changes_after_division(count, Vec3d::UnitY());
    EXPECT_LT(rotating[0], 0.08);
    EXPECT_LT(rotating[1], 0.04);
  }
}

TEST(SharedObject, AnOwnedObjectFallsAsleepOnTheGroundAndWakesWhenTouched) {
  BodyState state;
  state.position.z() = 0.06;
  SharedObject object{box_body(0.3, {0.05, 0.05, 0.05}), state};
  object.simulate_alone();
  for (int i = 0; i < 1000; ++i) object.step(i * kCycleNs, {}, {}, kCycle);
  EXPECT_TRUE(object.is_asleep());
  const BodyState still = object.state();
  for (int i = 1000; i < 1100; ++i) object.step(i * kCycleNs, {}, {}, kCycle);
  EXPECT_EQ(object.state().position, still.position);
  PointSpring spring;
  spring.point = object.state().position;
  spring.target = spring.point + Vec3d{0.02, 0, 0};
  spring.stiffness = 500;
  object.step(1100 * kCycleNs, {&spring, 1}, {}, kCycle);
  EXPECT_FALSE(object.is_asleep());
  EXPECT_GT(object.state().velocity.x(), 0);
}

TEST(SharedObject, AFollowingObjectStaysAtItsLastPose) {
  SharedObject object{box_body(0.3, {0.05, 0.05, 0.05})};
  object.follow();
  BodyState state;
  state.position = {1, 2, 3};
  object.set_state(state);
  for (int i = 0; i < 100; ++i) object.step(i * kCycleNs, {}, {}, kCycle);
  EXPECT_EQ(object.state().position, state.position);
}

/// Returns the energy that a copy credits when its peer puts 0.1 J into the channel in 100 samples. The energy counter
/// of sample `wrong_index` is `wrong_counter`; the samples are numbered from 1.
double credited_energy(std::size_t wrong_index, double wrong_counter) {
  CopyCoupling coupling{{}, 0, floating_box(1)};
  coupling.start(0, {});
  const double before = coupling.ledger().received;
  CopySample sample;
  for (std::size_t i = 1; i <= 100; ++i) {
    sample.time_ns = static_cast<std::int64_t>(i) * kCycleNs;
    sample.energy[0] = i == wrong_index ? wrong_counter : 1e-3 * static_cast<double>(i);
    coupling.on_sample(1, sample);
  }
  return coupling.ledger().received - before;
}

TEST(CopyCoupling, OneCounterFarAboveTheOthersDoesNotEndTheCredit) {
  EXPECT_NEAR(credited_energy(0, 0), 0.1, 1e-9);
  const double tank = CouplingSettings{}.tank;
  for (const double wrong_counter : {1e3, 1e300}) {
    EXPECT_GT(credited_energy(50, wrong_counter), 0.098);
    EXPECT_LE(credited_energy(50, wrong_counter), 0.1 + tank) << "the credit from one sample is bounded";
  }
}

}  // namespace
}  // namespace tactus::haptics
