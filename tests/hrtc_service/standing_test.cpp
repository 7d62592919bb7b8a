// A box that lies on the organ, from the host that has let it come to rest there to an HRTC whose user touches it.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/bodies.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/local_session.hpp"

namespace tactus {
namespace {

using spm::Vec3d;
using test_support::LocalSession;

constexpr std::int64_t kMs = 1'000'000;
constexpr double kHalf = 0.01;  // m, of the box's edges
constexpr double kMass = 0.2;   // kg, of the box
constexpr session::Material kRough{1000, 3, 0.9, 0.8};

class OnTheOrgan : public ::testing::Test {
 protected:
  OnTheOrgan()
      : session_{{organ_.model(), box_.model()}, 1, spm::PoolSettings::for_slots(1 << 15), 2, {}, kRough, kMass} {}

  [[nodiscard]] static spm::offline::TriangleMesh box_mesh() {
    spm::offline::TriangleMesh mesh = spm::offline::generate(spm::offline::Shape::kBox, 1200);
    for (auto& p : mesh.positions)
      for (float& x : p) x *= static_cast<float>(kHalf / 0.05);
    return mesh;
  }

  /// Where a host's box that is dropped on the organ's top comes to rest.
  [[nodiscard]] haptics::BodyState at_rest() const {
    const std::vector<spm::Model> models{organ_.model(), box_.model()};
    const std::vector<spm::codec::EncodedModel> encoded{models.begin(), models.end()};
    host_service::HostCoreSettings settings = LocalSession::host_settings(encoded, 1, kRough, kMass);
    const auto top = std::max_element(organ_mesh_.positions.begin(), organ_mesh_.positions.end(),
                                      [](const auto& a, const auto& b) { return a[2] < b[2]; });
    settings.objects[1].config.pose->position = {(*top)[0], (*top)[1], (*top)[2] + 0.02};
    host_service::HostCore host{session::Origin{LocalSession::kSession, LocalSession::kHost, 1, 0}, settings, 0};
    session::Pose pose;
    for (std::int64_t now = kMs; now < 3000 * kMs; now += kMs)
      for (const session::ObjectPose& published : host.tick(now).poses) pose = published.pose;
    EXPECT_FALSE(host.authority().busy());
    return sharing::state_at(pose, Vec3d::Zero());
  }

  void cycle(const Vec3d& device, bool grab) {
    session_.prepare(device, Vec3d::Zero());
    session_.inputs()[0].device.buttons = grab ? std::uint32_t{haptics::kGrabButton} : 0u;
    session_.core().link().bodies.orders.post(orders_);
    outputs_ = session_.touch_with_bodies();
    (void)session_.core().servo().refine(spm::Budget{1u << 20});
    (void)session_.core().link().bodies.reports_for_sender.take(reports_);
  }

  spm::offline::TriangleMesh organ_mesh_ = spm::offline::generate(spm::offline::Shape::kOrgan, 40'000);
  spm::offline::BuiltModel organ_{spm::offline::build_model(organ_mesh_)};
  spm::offline::BuiltModel box_{spm::offline::build_model(box_mesh())};
  LocalSession session_;
  hrtc_service::BodyOrders orders_;
  hrtc_service::BodyReports reports_;
  std::array<hrtc_service::ProbeOutput, hrtc_service::kMaxProbes> outputs_;
};

TEST_F(OnTheOrgan, ABoxStaysWhereItsHostLeftItWhenAHandTouchesItAndFallsBackThere) {
  const haptics::BodyState rest = at_rest();
  orders_.number = orders_.count = 1;
  orders_.bodies[0].object = 1;
  orders_.bodies[0].received = {rest, 0, 1};
  const Vec3d above = rest.position + Vec3d{0, 0, kHalf + 0.01};
  for (int i = 0; i < 300; ++i) cycle(above, false);
  ASSERT_EQ(reports_.count, 1u);
  EXPECT_LT((reports_.bodies[0].state.position - rest.position).norm(), 1e-9) << "shown at the received pose";

  // Down to it, pressed by some tenths of a newton.
  double off = 0;
  Vec3d hand = above;
  for (int i = 0; i < 600; ++i) {
    hand.z() = std::max(hand.z() - 3e-5, rest.position.z() + kHalf + 0.0027);
    cycle(hand, false);
    off = std::max(off, (reports_.bodies[0].state.position - rest.position).norm());
  }
  EXPECT_TRUE(reports_.bodies[0].is_touched);
  EXPECT_GT(outputs_[0].force[2], 0.1);
  EXPECT_LT(off, 5e-4) << "neither sunk nor pushed out";

  // Up by a centimetre and let go.
  for (int i = 0; i < 1000; ++i) {
    hand.z() += i < 500 ? 2.5e-5 : 0;
    cycle(hand, true);
  }
  EXPECT_GT(reports_.bodies[0].state.position.z(), rest.position.z() + 0.005);
  for (int i = 0; i < 250; ++i) cycle(hand + Vec3d{0, 0, 5e-5 * i}, false);
  EXPECT_NEAR(reports_.bodies[0].state.position.z(), rest.position.z(), 0.002);
}

TEST(ToolAndBody, AStylusPushesABoxAlongTheGroundAndFeelsItsFriction) {
  constexpr double kEdge = 0.03, kSpeed = 0.05;  // m, half an edge; m/s
  spm::offline::TriangleMesh mesh = spm::offline::generate(spm::offline::Shape::kBox, 1200);
  for (auto& p : mesh.positions)
    for (float& x : p) x *= static_cast<float>(kEdge / 0.05);
  const spm::offline::BuiltModel box{spm::offline::build_model(mesh)};
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  hrtc_service::LoaderSettings loader;
  loader.tool = &probe;
  const session::Material material{1000, 3, 0.5, 0.4};
  LocalSession session{{box.model()}, 1, spm::PoolSettings::for_slots(1 << 14), 2, loader, material, 0.2};
  hrtc_service::BodyReports reports;
  hrtc_service::BodyOrders orders;
  orders.number = orders.count = 1;
  orders.bodies[0].object = 0;
  orders.bodies[0].received.number = 1;
  orders.bodies[0].received.state.position = {0, 0, -1 + kEdge};  // the ground is at -1
  Vec3d hand{0.05, 0.002, -1 + 0.02};
  double pushed = 0, along = 0;
  int pushes = 0;
  for (int i = 0; i < 1300; ++i) {
    const Vec3d velocity = i < 300 ? Vec3d::Zero() : Vec3d{-kSpeed, 0, 0};
    hand += 1e-3 * velocity;
    session.prepare(hand, velocity);
    session.core().link().bodies.orders.post(orders);
    const hrtc_service::Servo::Outputs& outputs = session.touch_with_bodies();
    (void)session.core().servo().refine(spm::Budget{1u << 20});
    (void)session.core().link().bodies.reports_for_sender.take(reports);
    if (i < 1000) continue;
    ++pushes;
    along += outputs[0].force[0];
    pushed = reports.bodies[0].state.position.x();
  }
  ASSERT_EQ(reports.count, 1u);
  EXPECT_TRUE(reports.bodies[0].is_touched);
  EXPECT_NEAR(along / pushes, 0.5 * 0.2 * 9.81, 0.15) << "what the ground's friction takes";
  EXPECT_NEAR(pushed, hand.x() - 0.003 - kEdge + 0.001, 0.001) << "before the tip, which lags by a newton";
  EXPECT_NEAR(reports.bodies[0].state.position.z(), -1 + kEdge, 5e-4);
  EXPECT_LT(haptics::log_map(reports.bodies[0].state.orientation).norm(), 0.15) << "pushed 2 mm beside its middle";
  EXPECT_GE(reports.ports[0].lowest, -1e-6);
}

}  // namespace
}  // namespace tactus
