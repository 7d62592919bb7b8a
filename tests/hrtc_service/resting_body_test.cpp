// Movable boxes at an HRTC: a hand touches a box that came to rest on the organ at the host, and a tool pushes a box
// along the ground.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/servo/bodies.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/local_session.hpp"

namespace tactus {
namespace {

using spm::Vec3d;
using test_support::LocalSession;

constexpr double kBoxHalfEdge = 0.01;     // m, of the box on the organ
constexpr double kMass = 0.2;             // kg, of each box
constexpr double kMinPortEnergy = -1e-6;  // J, as in scenarios
constexpr session::Material kRough{1000, 3, 0.9, 0.8};

spm::offline::TriangleMesh box_mesh(double half_edge) {
  constexpr double kGenerated = 0.05;  // m, half edge of the generated box
  spm::offline::TriangleMesh mesh = spm::offline::generate(spm::offline::Shape::kBox, 1200);
  for (auto& position : mesh.positions)
    for (float& coordinate : position) coordinate *= static_cast<float>(half_edge / kGenerated);
  return mesh;
}

class BoxOnOrgan : public ::testing::Test {
 protected:
  BoxOnOrgan()
      : session_{{organ_.model(), box_.model()}, 1, spm::PoolSettings::for_slots(1 << 15), 2, {}, kRough, kMass} {}

  /// Simulates at a host how the box falls on the top of the organ. Returns its state at rest.
  [[nodiscard]] haptics::BodyState state_after_drop() const {
    const std::vector<spm::Model> models{organ_.model(), box_.model()};
    const std::vector<spm::codec::EncodedModel> encoded{models.begin(), models.end()};
    host_service::HostCoreSettings settings = LocalSession::host_settings(encoded, 1, kRough, kMass);
    const auto top = std::max_element(organ_mesh_.positions.begin(), organ_mesh_.positions.end(),
                                      [](const auto& a, const auto& b) { return a[2] < b[2]; });
    settings.objects[1].config.pose->position = {(*top)[0], (*top)[1], (*top)[2] + 0.02};
    host_service::HostCore host{session::Origin{kSession, kHost, 1, 0}, settings, 0};
    session::Pose pose;
    for (std::int64_t now = kMs; now < 3000 * kMs; now += kMs)
      for (const session::ObjectPose& published : host.tick(now).poses) pose = published.pose;
    EXPECT_FALSE(host.authority().busy());
    return sharing::state_at(pose, Vec3d::Zero());
  }

  /// Makes the HRTC receive the box at rest on the organ, from its host. Returns that state.
  haptics::BodyState receive_resting_box() {
    const haptics::BodyState resting = state_after_drop();
    orders_.count = 1;
    orders_.bodies[0].object = 1;
    orders_.bodies[0].received = {resting, 0, 1};
    return resting;
  }

  void run_cycle(const Vec3d& device, bool grab) {
    session_.prepare(device, Vec3d::Zero());
    session_.inputs()[0].device.buttons = grab ? std::uint32_t{haptics::kGrabButton} : 0u;
    run_prepared_cycle();
  }
  void run_prepared_cycle() {
    orders_.pose_number = orders_.bodies[0].received.number;
    hrtc_service::MailboxWriter{session_.core().link().bodies.granted}.post(orders_);
    session_.core().tick_intake();
    outputs_ = session_.touch_with_bodies();
    (void)session_.core().servo().refine(spm::Budget{1u << 20});
    (void)hrtc_service::MailboxReader{session_.core().link().bodies.reports}.take(reports_);
  }

  spm::offline::TriangleMesh organ_mesh_ = spm::offline::generate(spm::offline::Shape::kOrgan, 40'000);
  spm::offline::BuiltModel organ_{spm::offline::build_model(organ_mesh_)};
  spm::offline::BuiltModel box_{spm::offline::build_model(box_mesh(kBoxHalfEdge))};
  LocalSession session_;
  hrtc_service::GrantedBodies orders_;
  hrtc_service::BodyReports reports_;
  std::array<hrtc_service::ProbeOutput, hrtc_service::kMaxProbes> outputs_;
};

TEST_F(BoxOnOrgan, StaysAtRestWhenAHandTouchesItAndFallsBackAfterALift) {
  const haptics::BodyState resting = receive_resting_box();
  const Vec3d above = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.01};
  for (int cycle = 0; cycle < 300; ++cycle) run_cycle(above, false);
  ASSERT_EQ(reports_.count, 1u);
  EXPECT_LT((reports_.bodies[0].state.position - resting.position).norm(), 1e-9) << "shown at the received pose";

  // The hand presses on the box with some tenths of a newton.
  double max_shift = 0;
  Vec3d hand = above;
  for (int cycle = 0; cycle < 600; ++cycle) {
    hand.z() = std::max(hand.z() - 3e-5, resting.position.z() + kBoxHalfEdge + 0.0027);
    run_cycle(hand, false);
    max_shift = std::max(max_shift, (reports_.bodies[0].state.position - resting.position).norm());
  }
  EXPECT_TRUE(reports_.bodies[0].is_touched);
  EXPECT_GT(outputs_[0].force[2], 0.1);
  EXPECT_LT(max_shift, 5e-4) << "the box neither sinks into the organ nor leaves it";

  // The hand lifts the box by a centimetre and releases it.
  for (int cycle = 0; cycle < 1000; ++cycle) {
    hand.z() += cycle < 500 ? 2.5e-5 : 0;
    run_cycle(hand, true);
  }
  EXPECT_GT(reports_.bodies[0].state.position.z(), resting.position.z() + 0.005);
  for (int cycle = 0; cycle < 250; ++cycle) run_cycle(hand + Vec3d{0, 0, 5e-5 * cycle}, false);
  EXPECT_NEAR(reports_.bodies[0].state.position.z(), resting.position.z(), 0.002);
}

TEST_F(BoxOnOrgan, WithoutAGatewayItsForceEndsWithin60MsAndReturnsWithTheGateway) {
  const haptics::BodyState resting = receive_resting_box();
  const auto force = [&] { return hrtc_service::vec(outputs_[0].force).norm(); };
  Vec3d hand = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.0125};
  for (int cycle = 0; cycle < 600; ++cycle) {
    if (cycle < 400) hand.z() -= 0.01 / 400;
    run_cycle(hand, false);
  }
  const double before = force();
  ASSERT_GT(before, 0.1);
  session_.has_gateway = false;
  for (int cycle = 1; cycle <= 30; ++cycle) run_cycle(hand, false);
  EXPECT_GT(force(), 0.5 * before) << "a busy gateway";
  for (int cycle = 31; cycle <= 60; ++cycle) run_cycle(hand, false);
  for (int cycle = 0; cycle < 100; ++cycle) {
    EXPECT_EQ(force(), 0);
    run_cycle(hand, false);
  }
  session_.has_gateway = true;
  for (int cycle = 0; cycle < 200; ++cycle) run_cycle(hand, false);
  EXPECT_GT(force(), 0.5 * before);
}

TEST_F(BoxOnOrgan, WithoutAGatewayItsForceEndsWithin60MsAlsoWhenCyclesAreLate) {
  constexpr std::int64_t kLateMs = 8;  // between two cycles
  const haptics::BodyState resting = receive_resting_box();
  Vec3d hand = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.0125};
  for (int cycle = 0; cycle < 600; ++cycle) {
    if (cycle < 400) hand.z() -= 0.01 / 400;
    run_cycle(hand, false);
  }
  const auto force = [&] { return hrtc_service::vec(outputs_[0].force).norm(); };
  const double before = force();
  ASSERT_GT(before, 0.1);
  session_.has_gateway = false;
  const auto run_late_cycle = [&] {
    session_.pause((kLateMs - 1) * kMs);
    run_cycle(hand, false);
  };
  for (int cycle = 1; cycle <= 30 / kLateMs; ++cycle) run_late_cycle();
  EXPECT_GT(force(), 0.5 * before) << "a busy gateway";
  for (int cycle = 30 / kLateMs + 1; cycle <= 60 / kLateMs + 1; ++cycle) run_late_cycle();
  EXPECT_EQ(force(), 0);
  EXPECT_EQ(outputs_[0].status & (session::kFault | session::kStalePose), std::uint32_t{session::kStalePose});
}

TEST_F(BoxOnOrgan, UnderAnotherGatewayItsForceReturnsWhenAPoseOfItHasArrived) {
  const haptics::BodyState resting = receive_resting_box();
  const auto force = [&] { return hrtc_service::vec(outputs_[0].force).norm(); };
  const Vec3d pressed = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.0025};
  for (int cycle = 0; cycle < 600; ++cycle) run_cycle(pressed + Vec3d{0, 0, std::max(0.0, 0.01 - 3e-5 * cycle)}, false);
  const double before = force();
  ASSERT_GT(before, 0.1);
  ASSERT_TRUE(reports_.bodies[0].is_touched);
  session_.has_gateway = false;
  for (int cycle = 0; cycle < 100; ++cycle) run_cycle(pressed, false);
  session_.restart_gateway();
  session_.has_gateway = true;
  for (int cycle = 0; cycle < 1000; ++cycle) {  // a gateway with heartbeats, which has passed no pose
    run_cycle(pressed, false);
    ASSERT_EQ(force(), 0) << "cycle " << cycle;
    ASSERT_FALSE(reports_.bodies[0].is_touched) << "the gateway would claim the box, cycle " << cycle;
  }
  ASSERT_EQ(session_.loader().objects().size(), 2u) << "the servo has kept the box";
  orders_.bodies[0].received.number = 2;
  for (int cycle = 0; cycle < 300; ++cycle) run_cycle(pressed, false);
  EXPECT_GT(force(), 0.5 * before);
  EXPECT_TRUE(reports_.bodies[0].is_touched);
  EXPECT_GE(reports_.ports[0].lowest, kMinPortEnergy);
}

TEST_F(BoxOnOrgan, UnderAnotherGatewayItAppearsWhereOthersHaveMovedItAndPushesNoHand) {
  const haptics::BodyState resting = receive_resting_box();
  const auto force = [&] { return hrtc_service::vec(outputs_[0].force).norm(); };
  const Vec3d pressed = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.0025};
  for (int cycle = 0; cycle < 600; ++cycle) run_cycle(pressed + Vec3d{0, 0, std::max(0.0, 0.01 - 3e-5 * cycle)}, false);
  ASSERT_GT(force(), 0.1);
  session_.has_gateway = false;
  for (int cycle = 0; cycle < 100; ++cycle) run_cycle(pressed, false);
  session_.restart_gateway();
  session_.has_gateway = true;
  for (int cycle = 0; cycle < 500; ++cycle) run_cycle(pressed, false);
  orders_.bodies[0].received.number = 2;
  orders_.bodies[0].received.state.position.z() += 0.2;
  run_cycle(pressed, false);
  EXPECT_LT((reports_.bodies[0].state.position - orders_.bodies[0].received.state.position).norm(), 1e-9);
  for (int cycle = 0; cycle < 300; ++cycle) {
    run_cycle(pressed, false);
    ASSERT_EQ(force(), 0) << "cycle " << cycle;
  }
}

TEST_F(BoxOnOrgan, WithoutAGatewayAHandLetsGoOfItWithin60Ms) {
  const haptics::BodyState resting = receive_resting_box();
  Vec3d hand = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.0125};
  for (int cycle = 0; cycle < 600; ++cycle) {
    if (cycle < 400) hand.z() -= 0.01 / 400;
    run_cycle(hand, cycle >= 400);
  }
  const auto holds = [&] { return (outputs_[0].status & session::kHolding) != 0; };
  ASSERT_TRUE(holds());
  session_.has_gateway = false;
  for (int cycle = 1; cycle <= 30; ++cycle) run_cycle(hand, true);
  EXPECT_TRUE(holds()) << "a busy gateway";
  for (int cycle = 31; cycle <= 62; ++cycle) run_cycle(hand, true);
  EXPECT_FALSE(holds());
  session_.has_gateway = true;
  for (int cycle = 0; cycle < 200; ++cycle) run_cycle(hand, true);
  EXPECT_FALSE(holds()) << "until the hand opens and closes again";
}

TEST_F(BoxOnOrgan, WithoutAGatewayTheOrganCanBeTouchedForFiveSeconds) {
  (void)receive_resting_box();
  const auto& bottom = *std::min_element(organ_mesh_.positions.begin(), organ_mesh_.positions.end(),
                                         [](const auto& a, const auto& b) { return a[2] < b[2]; });
  const Vec3d pressed{bottom[0], bottom[1], bottom[2] - 0.0015};  // a tip has a radius of 3 mm
  for (int cycle = 0; cycle < 600; ++cycle) run_cycle(pressed - Vec3d{0, 0, std::max(0.0, 0.01 - 3e-5 * cycle)}, false);
  const Vec3d force = hrtc_service::vec(outputs_[0].force);
  ASSERT_GT(force.norm(), 0.5);
  session_.has_gateway = false;
  for (int cycle = 0; cycle < 4900; ++cycle) {
    run_cycle(pressed, false);
    ASSERT_LT((hrtc_service::vec(outputs_[0].force) - force).norm(), 0.05 * force.norm()) << "cycle " << cycle;
  }
  double before = force.norm();
  for (int cycle = 4900; cycle < 5600; ++cycle) {
    run_cycle(pressed, false);
    const double now = hrtc_service::vec(outputs_[0].force).norm();
    ASSERT_LT(before - now, 0.01 * force.norm()) << "the force ends gradually, cycle " << cycle;
    before = now;
  }
  EXPECT_EQ(before, 0);
  session_.has_gateway = true;
  for (int cycle = 0; cycle < 600; ++cycle) run_cycle(pressed, false);
  EXPECT_LT((hrtc_service::vec(outputs_[0].force) - force).norm(), 0.05 * force.norm());
}

TEST_F(BoxOnOrgan, APauseOfTheWholeMachineIsNoSilenceOfTheGateway) {
  const haptics::BodyState resting = receive_resting_box();
  const Vec3d pressed = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.0025};
  for (int cycle = 0; cycle < 600; ++cycle) run_cycle(pressed + Vec3d{0, 0, std::max(0.0, 0.01 - 3e-5 * cycle)}, false);
  const double force = hrtc_service::vec(outputs_[0].force).norm();
  session_.has_gateway = false;
  session_.pause(1'000'000'000);
  for (int cycle = 0; cycle < 10; ++cycle) {
    run_cycle(pressed, false);
    EXPECT_GT(hrtc_service::vec(outputs_[0].force).norm(), 0.5 * force);
  }
}

/// A device state with one number that is not finite.
haptics::DeviceState invalid_state(const haptics::DeviceState& valid, int number) {
  haptics::DeviceState state = valid;
  const double invalid = std::numeric_limits<double>::quiet_NaN();
  if (number == 0) state.position.x() = invalid;
  if (number == 1) state.velocity.y() = std::numeric_limits<double>::infinity();
  if (number == 2) state.orientation.z() = invalid;
  return state;
}

TEST_F(BoxOnOrgan, AResetBeginsNoGraspOfAHandThatClosedDuringAFault) {
  const haptics::BodyState resting = receive_resting_box();
  Vec3d hand = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.01};
  const auto is_holding = [&] { return (outputs_[0].status & session::kHolding) != 0; };
  for (int cycle = 0; cycle < 600; ++cycle) {
    hand.z() = std::max(hand.z() - 3e-5, resting.position.z() + kBoxHalfEdge + 0.0027);
    run_cycle(hand, false);
  }
  ASSERT_NE(outputs_[0].status & session::kInContact, 0u);
  session_.cycle().stop(haptics::Fault::kEmergencyStop);
  for (int cycle = 0; cycle < 10; ++cycle) run_cycle(hand, true);
  EXPECT_NE(outputs_[0].status & session::kHoldRefused, 0u);
  session_.cycle().reset_faults();
  for (int cycle = 0; cycle < 100; ++cycle) {
    run_cycle(hand, true);
    ASSERT_FALSE(is_holding()) << "cycle " << cycle;
  }
  run_cycle(hand, false);
  for (int cycle = 0; cycle < 2; ++cycle) run_cycle(hand, true);
  EXPECT_TRUE(is_holding()) << "it has opened";
}

// The force of a hand in the corner of both comes from both, whichever is reported as touched.
class HandBesideBox : public BoxOnOrgan, public ::testing::WithParamInterface<double> {};

TEST_P(HandBesideBox, WithoutAGatewayAForceOfTheOrganEndsWithin60MsIfTheTipReachesIntoTheBoundsOfTheBox) {
  const double distance = GetParam();
  const haptics::BodyState resting = receive_resting_box();
  orders_.bodies[0].received.state.position.z() -= 0.02;  // into the organ, because the organ falls steeply beside it
  const auto force = [&] { return hrtc_service::vec(outputs_[0].force).norm(); };
  Vec3d hand = resting.position + Vec3d{distance, 0, 0.01};
  for (int cycle = 0; cycle < 600; ++cycle) run_cycle(hand, false);
  while (force() < 0.2) {
    hand.z() -= 1e-5;
    run_cycle(hand, false);
    ASSERT_GT(hand.z(), resting.position.z() - 0.1);
  }
  ASSERT_EQ(outputs_[0].object, 0u) << "the organ";
  session_.has_gateway = false;
  for (int cycle = 0; cycle < 61; ++cycle) run_cycle(hand, false);
  EXPECT_EQ(force() > 0, distance > 0.02);
}

INSTANTIATE_TEST_SUITE_P(Distances, HandBesideBox, ::testing::Values(0.0135, 0.03));

TEST_F(BoxOnOrgan, OneInvalidStateOfAHandThatPressesOrHoldsItLeavesItsStateFinite) {
  const haptics::BodyState resting = receive_resting_box();
  const Vec3d above = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.01};
  const Vec3d pressed = resting.position + Vec3d{0, 0, kBoxHalfEdge + 0.0025};
  for (const bool grab : {false, true}) {
    for (int number = 0; number < 3; ++number) {
      const std::string where = "number " + std::to_string(number) + (grab ? ", held" : ", pressed");
      session_.cycle().reset_faults();
      for (int cycle = 0; cycle < 500; ++cycle) run_cycle(above, false);
      Vec3d hand = above;
      for (int cycle = 0; cycle < 600; ++cycle) {
        hand.z() = std::max(hand.z() - 3e-5, pressed.z());
        run_cycle(hand, grab && hand.z() == pressed.z());
      }
      ASSERT_NE(outputs_[0].status & (grab ? session::kHolding : session::kInContact), 0u) << where;
      session_.prepare(hand, Vec3d::Zero());
      haptics::DeviceState& device = session_.inputs()[0].device;
      device.buttons = grab ? std::uint32_t{haptics::kGrabButton} : 0u;
      const Eigen::Quaterniond orientation = device.orientation;
      device = invalid_state(device, number);
      run_prepared_cycle();
      device.orientation = orientation;
      run_cycle(hand, grab);
      const haptics::BodyState& state = reports_.bodies[0].state;
      EXPECT_TRUE(state.position.allFinite() && state.velocity.allFinite() && state.angular_velocity.allFinite() &&
                  state.orientation.coeffs().allFinite())
          << where;
      EXPECT_LT((state.position - resting.position).norm(), 0.01) << where;
      const std::uint64_t refused = reports_.rotational_ports[0].invalid_inputs;
      run_cycle(hand, false);
      EXPECT_EQ(reports_.rotational_ports[0].invalid_inputs, refused) << "a later input counts as invalid; " << where;
    }
  }
}

/// A box on the ground beside a hand with a tip or a stylus.
class BoxOnGround {
 public:
  static constexpr double kHalfEdge = 0.03;  // m
  static constexpr double kGround = -1;      // m, as in LocalSession

  explicit BoxOnGround(bool has_tool)
      : session_{{box_.model()},
                 1,
                 spm::PoolSettings::for_slots(1 << 14),
                 2,
                 loader_settings(has_tool ? &stylus_ : nullptr),
                 kMaterial,
                 kMass} {
    orders_.count = 1;
    orders_.bodies[0].object = 0;
    orders_.bodies[0].received.number = 1;
    orders_.bodies[0].received.state.position = {0, 0, kGround + kHalfEdge};
  }

  /// Runs a cycle. `pose_age`: age of the device's state in s; a state above 0 s is that of the last cycle.
  void run_cycle(const Vec3d& hand, const Vec3d& velocity, double pose_age = 0, bool grab = false) {
    haptics::DeviceState& device = session_.inputs()[0].device;
    const haptics::DeviceState before = device;
    session_.prepare(hand, velocity);
    device.buttons = grab ? std::uint32_t{haptics::kGrabButton} : 0u;
    if (pose_age > 0) device = before;
    session_.inputs()[0].pose_age = pose_age;
    orders_.pose_number = orders_.bodies[0].received.number;
    hrtc_service::MailboxWriter{session_.core().link().bodies.granted}.post(orders_);
    session_.core().tick_intake();
    output_ = session_.touch_with_bodies()[0];
    (void)session_.core().servo().refine(spm::Budget{1u << 20});
    (void)hrtc_service::MailboxReader{session_.core().link().bodies.reports}.take(reports_);
  }

  void set_gateway(bool has_gateway) { session_.has_gateway = has_gateway; }
  [[nodiscard]] const hrtc_service::ProbeOutput& output() const { return output_; }
  [[nodiscard]] const hrtc_service::BodyReports& reports() const { return reports_; }
  [[nodiscard]] const haptics::BodyState& body() const { return reports_.bodies[0].state; }

 private:
  static constexpr session::Material kMaterial{1000, 3, 0.5, 0.4};

  static hrtc_service::LoaderSettings loader_settings(const spm::MeshProbe* tool) {
    hrtc_service::LoaderSettings settings;
    settings.tool = tool;
    return settings;
  }

  spm::offline::BuiltModel box_{spm::offline::build_model(box_mesh(kHalfEdge))};
  spm::offline::TriangleMesh stylus_mesh_ = spm::offline::stylus();
  spm::MeshProbe stylus_{stylus_mesh_.positions, stylus_mesh_.faces};
  LocalSession session_;
  hrtc_service::GrantedBodies orders_;
  hrtc_service::BodyReports reports_;
  hrtc_service::ProbeOutput output_;
};

TEST(BodyOnGround, AStylusPushesABoxAlongTheGroundAndFeelsItsFriction) {
  constexpr double kSpeed = 0.05;  // m/s
  BoxOnGround session{true};
  Vec3d hand{0.05, 0.002, BoxOnGround::kGround + 0.02};
  double force_sum = 0;
  int pushed_cycles = 0;
  for (int cycle = 0; cycle < 1300; ++cycle) {
    const Vec3d velocity = cycle < 300 ? Vec3d::Zero() : Vec3d{-kSpeed, 0, 0};
    hand += 1e-3 * velocity;
    session.run_cycle(hand, velocity);
    if (cycle < 1000) continue;
    ++pushed_cycles;
    force_sum += session.output().force[0];
  }
  ASSERT_EQ(session.reports().count, 1u);
  EXPECT_TRUE(session.reports().bodies[0].is_touched);
  EXPECT_NEAR(force_sum / pushed_cycles, 0.5 * kMass * 9.81, 0.15) << "the friction of the ground";
  EXPECT_NEAR(session.body().position.x(), hand.x() - 0.003 - BoxOnGround::kHalfEdge + 0.001, 0.001)
      << "in front of the tip, which 1 N displaces by 1 mm from the device";
  EXPECT_NEAR(session.body().position.z(), BoxOnGround::kGround + BoxOnGround::kHalfEdge, 5e-4);
  EXPECT_LT(haptics::log_map(session.body().orientation).norm(), 0.15) << "the push is 2 mm off the centre";
  EXPECT_GE(session.reports().ports[0].lowest, kMinPortEnergy);
}

TEST(BodyOnGround, TheForceChangesByAtMostFiveNewtonsInACycle) {
  constexpr double kMaxChange = 5, kSpeed = 1.4;  // N; m/s, of a device with noise
  for (const bool has_tool : {false, true}) {
    SCOPED_TRACE(has_tool ? "stylus" : "tip");
    BoxOnGround session{has_tool};
    Vec3d hand{0, 0, BoxOnGround::kGround + 2 * BoxOnGround::kHalfEdge + 0.006};
    Vec3d before = Vec3d::Zero();
    double largest = 0, max_change = 0;
    bool was_limited = false;
    for (int cycle = 0; cycle < 1000; ++cycle) {
      hand.z() -= cycle < 900 ? 1e-5 : 0;
      const double side = cycle < 900 ? 0 : (cycle / 2 % 2 == 0 ? kSpeed : -kSpeed);
      session.run_cycle(hand, {side, 0, 0});
      const Vec3d force = hrtc_service::vec(session.output().force);
      largest = std::max(largest, force.norm());
      max_change = std::max(max_change, (force - before).norm());
      was_limited |= cycle >= 900 && (session.output().status & session::kForceRamped) != 0;
      before = force;
    }
    EXPECT_GT(largest, kMaxChange);
    EXPECT_LE(max_change, kMaxChange + 1e-9);
    EXPECT_TRUE(was_limited);
    while (hrtc_service::vec(session.output().force).norm() < kMaxChange) {
      hand.z() -= 1e-5;
      session.run_cycle(hand, Vec3d::Zero());
    }
    session.run_cycle(hand, Vec3d::Zero(), 0.07);
    EXPECT_EQ(hrtc_service::vec(session.output().force).norm(), 0) << "a stale pose ends the force at once";
  }
}

// Without friction, only the damper of the movable box acts along the surface. It ends where the fixed box or the air
// begins.
class BodyBesideFixedObject : public ::testing::TestWithParam<bool> {};

TEST_P(BodyBesideFixedObject, TheForceChangesByAtMostFiveNewtonsInACycleWhenATipSlidesOffTheBody) {
  const bool to_fixed = GetParam();
  const double direction = to_fixed ? -1 : 1;
  constexpr double kHalf = 0.03, kSpeed = 1.4, kMaxChange = 5, kDepth = 0.007;  // m, m/s, N, m
  const spm::offline::BuiltModel box = spm::offline::build_model(box_mesh(kHalf));
  LocalSession session{
      {box.model(), box.model()}, 1, spm::PoolSettings::for_slots(1 << 15), 2, {}, {1000, 6, 0, 0}, kMass};
  hrtc_service::GrantedBodies orders;
  orders.count = 1;
  orders.bodies[0].object = 1;
  orders.bodies[0].received.number = 1;
  orders.bodies[0].received.state.position = {2 * kHalf, 0, 0};
  Vec3d force = Vec3d::Zero();
  double along = 0, max_change = 0;
  const auto run_cycle = [&](const Vec3d& hand, const Vec3d& velocity) {
    orders.pose_number = orders.bodies[0].received.number;
    hrtc_service::MailboxWriter{session.core().link().bodies.granted}.post(orders);
    session.core().tick_intake();
    session.prepare(hand, velocity);
    const hrtc_service::ProbeOutput output = session.touch_with_bodies()[0];
    (void)session.core().servo().refine(spm::Budget{1u << 20});
    const Vec3d before = std::exchange(force, hrtc_service::vec(output.force));
    max_change = std::max(max_change, (force - before).norm());
    along = std::max(along, std::abs(force.x()));
    return output.object;
  };
  // The movable box falls once it is touched, so the hand is fast.
  Vec3d hand{(2 + 0.7 * direction) * kHalf, 0, kHalf + 0.01};
  for (int cycle = 0; cycle < 600; ++cycle) (void)run_cycle(hand, Vec3d::Zero());
  std::uint32_t object = 1;
  while (hand.z() > kHalf + 0.003 - kDepth) {
    hand.z() -= 1e-3;
    object = run_cycle(hand, {0, 0, -1});
  }
  ASSERT_EQ(object, 1u);
  ASSERT_GT(force.z(), kMaxChange);
  for (int cycle = 0; cycle < 18; ++cycle) {
    hand.x() += direction * 1e-3 * kSpeed;
    object = run_cycle(hand, {direction * kSpeed, 0, 0});
  }
  EXPECT_EQ(object, to_fixed ? 0u : spm::kNone);
  EXPECT_GT(along, kMaxChange);
  EXPECT_LE(max_change, kMaxChange + 1e-9);
  EXPECT_NEAR(force.z(), to_fixed ? 1000 * kDepth : 0, 0.5);
}

INSTANTIATE_TEST_SUITE_P(ToFixedObjectOrAir, BodyBesideFixedObject, ::testing::Bool());

TEST(BodyOnGround, ABoxThatIsFarFromItsStartPassesNoHandOnItsWay) {
  for (const bool has_tool : {false, true}) {
    SCOPED_TRACE(has_tool ? "stylus" : "tip");
    BoxOnGround session{has_tool};
    const Vec3d hand{0, 0, BoxOnGround::kGround + 2 * BoxOnGround::kHalfEdge + 0.0125};
    for (int cycle = 0; cycle < 500; ++cycle) {
      session.run_cycle(hand, Vec3d::Zero());
      ASSERT_EQ(hrtc_service::vec(session.output().force).norm(), 0) << "cycle " << cycle;
    }
    EXPECT_NEAR(session.body().position.z(), BoxOnGround::kGround + BoxOnGround::kHalfEdge, 1e-6);
    EXPECT_FALSE(session.reports().bodies[0].is_touched);
  }
}

enum class Silent { kDevice, kGateway };

/// Pushes a box, and moves the hand on by 10 mm while device or gateway are silent and no force acts.
void push_through_silence(BoxOnGround& session, Silent silent) {
  constexpr double kSpeed = 0.05;  // m/s
  constexpr int kSilent = 200;     // cycles
  Vec3d hand{0.05, 0.002, BoxOnGround::kGround + 0.02};
  const auto push = [&](int cycles, double speed) {
    for (int cycle = 0; cycle < cycles; ++cycle) {
      const Vec3d velocity{-speed, 0, 0};
      hand += 1e-3 * velocity;
      session.run_cycle(hand, velocity);
    }
  };
  push(300, 0);
  push(700, kSpeed);
  ASSERT_TRUE(session.reports().bodies[0].is_touched);
  ASSERT_GE(session.reports().ports[0].lowest, kMinPortEnergy);
  session.set_gateway(silent != Silent::kGateway);
  for (int cycle = 1; cycle <= kSilent; ++cycle) {
    const Vec3d velocity{-kSpeed, 0, 0};
    hand += 1e-3 * velocity;
    session.run_cycle(hand, velocity, silent == Silent::kDevice ? 1e-3 * cycle : 0);
  }
  ASSERT_EQ(hrtc_service::vec(session.output().force).norm(), 0);
  session.set_gateway(true);
  push(500, 0);
  EXPECT_GE(session.reports().ports[0].lowest, kMinPortEnergy);

  const Vec3d before = session.body().position;
  push(500, kSpeed);
  EXPECT_NEAR(session.output().force[0], 0.5 * kMass * 9.81, 0.3) << "the friction of the ground";
  EXPECT_GT(before.x() - session.body().position.x(), 0.02) << "the hand pushes the box again";
  EXPECT_GE(session.reports().ports[0].lowest, kMinPortEnergy);
}

TEST(BodyOnGround, AForceThatReturnsAfterSilenceGivesABoxNoEnergyThatTheHandHasNotGiven) {
  for (const bool has_tool : {false, true})
    for (const Silent silent : {Silent::kDevice, Silent::kGateway}) {
      SCOPED_TRACE(std::string{has_tool ? "stylus" : "tip"} +
                   (silent == Silent::kDevice ? ", silent device" : ", silent gateway"));
      BoxOnGround session{has_tool};
      push_through_silence(session, silent);
    }
}

TEST(BodyOnGround, AHoldThatWeakensForAMomentGivesABoxNoEnergyThatTheHandHasNotGiven) {
  BoxOnGround session{false};
  const double top = BoxOnGround::kGround + 2 * BoxOnGround::kHalfEdge;
  Vec3d hand{0, 0, top + 0.0125};
  for (int cycle = 0; cycle < 600; ++cycle) {
    if (cycle < 400) hand.z() -= 0.01 / 400;
    session.run_cycle(hand, Vec3d::Zero(), 0, cycle >= 400);
  }
  const auto lift = [&](int cycles, double speed) {
    for (int cycle = 0; cycle < cycles; ++cycle) {
      hand.z() += 1e-3 * speed;
      session.run_cycle(hand, {0, 0, speed}, 0, true);
    }
  };
  lift(1000, 0.05);
  lift(200, 0);
  ASSERT_NE(session.output().status & session::kHolding, 0u);
  ASSERT_GE(session.reports().ports[0].lowest, kMinPortEnergy);
  for (int cycle = 1; cycle <= 50; ++cycle) session.run_cycle(hand, Vec3d::Zero(), 1e-3 * cycle, true);
  lift(1000, 0);
  EXPECT_NE(session.output().status & session::kHolding, 0u);
  EXPECT_GE(session.reports().ports[0].lowest, kMinPortEnergy);
  EXPECT_GE(session.reports().rotational_ports[0].lowest, kMinPortEnergy);
}

}  // namespace
}  // namespace tactus
