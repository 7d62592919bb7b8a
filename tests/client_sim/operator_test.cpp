#include "client_sim/operator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <utility>
#include <vector>

#include "haptics/force.hpp"
#include "haptics/simulated_device.hpp"
#include "sharing/hand_path.hpp"
#include "spm/surface_points.hpp"
#include "tests/haptics/triangle_surface.hpp"

namespace tactus::client_sim {
namespace {

using haptics::testing::Triangle;
using haptics::testing::TriangleSurface;

/// One user, one HRTC, one object, and a network with delay in both directions: 1 kHz in simulated time.
class ClosedLoop {
 public:
  ClosedLoop(std::vector<Triangle> triangles, User user, std::int64_t delay_ns = 5'000'000)
      : surface_{std::move(triangles)}, delay_ns_{delay_ns}, operator_{user, {}} {
    haptics::HandSettings hand;
    hand.start = {0.05, 0.1, 0.3};
    device_.emplace(hand);
    limits_.soft_start = 0;
    force_.emplace(limits_, device_->spec());
    proxy_ = haptics::Proxy{[&] {
      haptics::ProxySettings settings;
      settings.radius = user.radius;
      return settings;
    }()};
    Vec3d low = Vec3d::Constant(1e9);
    Vec3d high = -low;
    for (const Triangle& triangle : surface_.triangles()) {
      for (const Vec3d& corner : triangle) {
        low = low.cwiseMin(corner);
        high = high.cwiseMax(corner);
      }
    }
    ObjectView view;
    view.id = 1;
    view.centre = (low + high) / 2;
    view.half_size = (high - low) / 2;
    objects_["body"] = view;
  }

  /// As published by a host: points of the surface; without this call there are bounds only.
  void publish_surface() {
    spm::BaseMesh mesh;
    for (const Triangle& triangle : surface_.triangles()) {
      spm::BaseFace face{{}, 1, {}};
      for (std::size_t k = 0; k < 3; ++k) {
        face.corners[k] = spm::VertexId{static_cast<std::uint32_t>(mesh.positions.size())};
        const Eigen::Vector3f corner = triangle[k].cast<float>();
        mesh.positions.push_back({corner[0], corner[1], corner[2]});
      }
      mesh.faces.push_back(face);
    }
    session::CatalogueEntry entry;
    entry.surface = spm::surface_points(mesh, session::kMaxSurfacePoints);
    const ObjectView view = view_of(entry);
    objects_["body"].surface = view.surface;
    objects_["body"].spacing = view.spacing;
  }

  void set_friction(double coefficient) { friction_ = coefficient; }

  /// Runs until the script ends or `seconds` have passed; calls `each` after every cycle.
  void run(double seconds, const std::function<void(double force, bool contact)>& each = {}) {
    const std::int64_t end = now_ns_ + static_cast<std::int64_t>(seconds * 1e9);
    for (; now_ns_ < end && !operator_.done(); now_ns_ += 1'000'000) {
      cycle();
      if (each) each(state_.force.norm(), state_.contact);
    }
  }

  void stop() { force_->latch(haptics::Fault::kEmergencyStop); }
  void reset() { force_->reset(); }
  [[nodiscard]] bool is_off() const { return fault_ != haptics::Fault::kNone; }

  [[nodiscard]] const Operator& user() const { return operator_; }
  [[nodiscard]] const Vec3d& proxy() const { return proxy_.last().proxy; }
  [[nodiscard]] double seconds() const { return static_cast<double>(now_ns_) * 1e-9; }
  /// Position of the tip in each cycle of following.
  std::vector<Vec3d> path;

 private:
  struct State {
    Vec3d force = Vec3d::Zero();
    bool contact = false;
  };

  void cycle() {
    while (!intents_.empty() && intents_.front().first <= now_ns_) {
      device_->paths().post(sharing::hand_path(intents_.front().second, 0));
      intents_.pop_front();
    }
    const haptics::DeviceState device = device_->read(now_ns_);
    const haptics::ContactImpedance impedance{1000, 1};
    proxy_.set_grip({friction_, 0.8 * friction_});
    const haptics::ProxyResult& touch = proxy_.step(device.position, 1e-3, surface_, false);
    const haptics::ForceResult& made = force_->step(touch, device, impedance, 0, 1e-3);
    state_.force = made.force;
    fault_ = made.fault;
    state_.contact = touch.in_contact;
    device_->write(state_.force);
    if (operator_.is_following()) path.push_back(touch.proxy);

    session::ProbeState sample;
    sample.user_id = session::id_of(operator_.user().name);
    sample.session_time_ns = now_ns_;
    for (int axis = 0; axis < 3; ++axis) {
      sample.device.position[axis] = device.position[axis];
      sample.proxy[axis] = touch.proxy[axis];
      sample.force[axis] = state_.force[axis];
    }
    if (state_.contact) sample.status |= session::kInContact;
    if (is_off()) sample.status |= session::kFault;
    states_.emplace_back(now_ns_ + delay_ns_, sample);
    while (states_.front().first <= now_ns_) {
      operator_.on_probe_state(states_.front().second);
      states_.pop_front();
    }
    if (const auto intent = operator_.tick(now_ns_, objects_)) intents_.emplace_back(now_ns_ + delay_ns_, *intent);
  }

  TriangleSurface surface_;
  std::int64_t delay_ns_;
  Operator operator_;
  haptics::ForceSettings limits_;
  std::optional<haptics::SimulatedDevice> device_;
  std::optional<haptics::ForceRenderer> force_;
  haptics::Proxy proxy_;
  Objects objects_;
  double friction_ = 0;
  State state_;
  haptics::Fault fault_ = haptics::Fault::kNone;
  std::int64_t now_ns_ = 1'000'000'000;
  std::deque<std::pair<std::int64_t, session::Intent>> intents_;
  std::deque<std::pair<std::int64_t, session::ProbeState>> states_;
};

User user_with(const std::string& script) {
  return parse_scenario("name: t\nusers:\n  - name: ann\n    script:\n" + script, "test").users.front();
}

struct Body {
  const char* name;
  std::vector<Triangle> triangles;
};

std::vector<Body> bodies() {
  return {{"sphere", haptics::testing::sphere(0.1, 4)}, {"bumpy", haptics::testing::bumpy(0.1, 4, 0.08)}};
}

TEST(Operator, SendsNothingBeforeItsFirstProbeState) {
  Operator ann{user_with("      - wait: {seconds: 1}\n"), {}};
  EXPECT_FALSE(ann.tick(1'000'000'000, {}).has_value());
}

TEST(Operator, TiltsWhileItFollowsAndComesUprightWithoutAStep) {
  Operator ann{user_with("      - follow: {object: body, seconds: 6, lean: 0.8}\n      - retreat: {}\n"), {}};
  ObjectView view;
  view.half_size = {0.1, 0.1, 0.1};
  session::ProbeState state;
  state.user_id = session::id_of("ann");
  const auto turned = [](const session::Waypoint& waypoint) {
    const auto& q = waypoint.pose.orientation;
    return Eigen::Quaterniond{q[3], q[0], q[1], q[2]};
  };
  Eigen::Quaterniond before = Eigen::Quaterniond::Identity();
  double max = 0, step = 0, off = 0, last = 0;
  for (std::int64_t now = 1'000'000'000; now < 14'000'000'000; now += 10'000'000) {
    const auto intent = ann.tick(now, {{"body", view}});
    if (!intent) continue;
    const Eigen::Quaterniond at = turned(intent->path[0]);
    step = std::max(step, at.angularDistance(before));
    last = at.angularDistance(Eigen::Quaterniond::Identity());
    max = std::max(max, last);
    before = at;
    if (intent->path.size() > 1) off = std::max(off, turned(intent->path[1]).angularDistance(at));
    // A table at 0.1 m.
    const auto& wish = intent->path[0].pose.position;
    state.session_time_ns = now;
    state.device.position = wish;
    const double depth = 0.1 - wish[2];
    state.proxy = {wish[0], wish[1], std::max(wish[2], 0.1)};
    state.force = {0, 0, std::max(0.0, 250 * depth)};
    state.status = depth > 0 ? session::kInContact : 0u;
    ann.on_probe_state(state);
  }
  EXPECT_TRUE(ann.done());
  EXPECT_GT(max, 0.8);
  EXPECT_LT(max, 0.8 * std::sqrt(6.0));  // about three axes, twice as far about the last
  EXPECT_LT(step, 0.1);
  EXPECT_LT(off, 0.4);
  EXPECT_LT(last, 0.05);
}

TEST(Operator, SendsIntentsAt100HzWithLookahead) {
  Operator ann{user_with("      - approach: {object: body}\n"), {}};
  session::ProbeState state;
  state.user_id = session::id_of("ann");
  state.session_time_ns = 1;
  state.device.position = {0, 0, 1};
  ann.on_probe_state(state);
  ObjectView view;
  view.half_size = {0.1, 0.1, 0.1};
  int intents = 0;
  for (std::int64_t now = 1'000'000'000; now < 2'000'000'000; now += 1'000'000) {
    const auto intent = ann.tick(now, {{"body", view}});
    if (!intent) continue;
    ++intents;
    EXPECT_EQ(intent->sequence, static_cast<std::uint32_t>(intents));
    ASSERT_EQ(intent->path.size(), 2u);
    EXPECT_EQ(intent->path[0].session_time_ns, now);
    EXPECT_EQ(intent->path[1].session_time_ns, now + 40'000'000);
  }
  EXPECT_EQ(intents, 100);
}

TEST(Operator, WaitsForAMissingObject) {
  Operator ann{user_with("      - approach: {object: body}\n"), {}};
  session::ProbeState state;
  state.user_id = session::id_of("ann");
  state.session_time_ns = 1;
  state.device.position = {0.1, 0.2, 0.3};
  ann.on_probe_state(state);
  const auto intent = ann.tick(1'000'000'000, {});
  ASSERT_TRUE(intent);
  EXPECT_EQ(intent->path.back().pose.position, state.device.position);
}

TEST(Operator, ApproachesUntilTheScriptedForce) {
  for (const Body& body : bodies()) {
    ClosedLoop loop{
        body.triangles,
        user_with("      - approach: {object: body, direction: [1, 1, 0.2], speed: 0.1, until_force: 0.5}\n")};
    double last = 0;
    loop.run(10, [&](double force, bool) { last = force; });
    EXPECT_TRUE(loop.user().done()) << body.name;
    EXPECT_GE(last, 0.4) << body.name;
    EXPECT_LT(last, 2) << body.name;
    EXPECT_GT(loop.proxy().dot(Vec3d(1, 1, 0.2).normalized()), 0.08) << body.name;
  }
}

TEST(Operator, StandsStillWhileItsForceIsOffAndGoesOnAfterTheReset) {
  for (const Body& body : bodies())
    for (const double stopped_after : {0.5, 1.0, 1.6, 3.0}) {  // s: on the way, pressing in, holding
      SCOPED_TRACE(std::string{body.name} + " " + std::to_string(stopped_after));
      ClosedLoop loop{body.triangles, user_with("      - approach: {object: body, direction: [0, 0, 1], speed: 0.2}\n"
                                                "      - hold: {seconds: 30, force: 1}\n")};
      loop.run(stopped_after);
      loop.stop();
      loop.run(4);
      loop.reset();
      double last = 0;
      bool off = false;
      loop.run(6, [&](double force, bool) {
        off = off || loop.is_off();
        last = force;
      });
      EXPECT_FALSE(off) << "its hand was thrown out of the object";
      EXPECT_GT(last, 0.5);
    }
}

/// A tube of `radius` along a closed or open line of points.
std::vector<Triangle> tube(const std::vector<Vec3d>& line, double radius, bool closed) {
  constexpr int kSides = 8;
  constexpr double kTurn = 6.283185307179586;
  const int count = static_cast<int>(line.size());
  const auto at = [&](int i) { return line[static_cast<std::size_t>((i + count) % count)]; };
  const auto corner = [&](int i, int side) {
    const Vec3d along = ((closed || i + 1 < count ? at(i + 1) : at(i)) - (closed || i > 0 ? at(i - 1) : at(i)));
    const Vec3d across = along.unitOrthogonal();
    const Vec3d other = along.normalized().cross(across);
    const double angle = kTurn * side / kSides;
    return Vec3d{at(i) + radius * (std::cos(angle) * across + std::sin(angle) * other)};
  };
  std::vector<Triangle> triangles;
  for (int i = 0; i < (closed ? count : count - 1); ++i) {
    for (int side = 0; side < kSides; ++side) {
      const Vec3d a = corner(i % count, side), b = corner(i % count, side + 1);
      const Vec3d c = corner((i + 1) % count, side), d = corner((i + 1) % count, side + 1);
      triangles.push_back({a, b, c});
      triangles.push_back({b, d, c});
    }
  }
  return triangles;
}

std::vector<Body> airy_bodies() {
  std::vector<Vec3d> ring, el, rod;
  for (int i = 0; i < 60; ++i) ring.push_back(0.1 * Vec3d{std::cos(0.1047197551 * i), std::sin(0.1047197551 * i), 0});
  for (int i = 10; i > 0; --i) el.push_back({0.02 * i, 0, 0});
  for (int i = 0; i <= 10; ++i) el.push_back({0, 0.02 * i, 0});
  for (int i = 0; i <= 30; ++i) rod.push_back(0.007 * i * Vec3d{1, 0.8, 0.3});
  return {{"ring", tube(ring, 0.004, true)}, {"L", tube(el, 0.005, false)}, {"rod", tube(rod, 0.003, false)}};
}

TEST(Operator, TouchesAFigureWhoseBoundsAreMostlyEmpty) {
  for (const Body& body : airy_bodies()) {
    for (const char* aimed :
         {"direction: [0, 0, 1]", "direction: [0.5, -0.3, 1]", "direction: [0, 0.2, 1], point: [0.7, 0.4, 0.5]"}) {
      ClosedLoop loop{body.triangles, user_with("      - approach: {object: body, " + std::string{aimed} +
                                                ", speed: 0.1, until_force: 0.5}\n")};
      loop.publish_surface();
      double max = 0;
      loop.run(20, [&](double force, bool) { max = std::max(max, force); });
      EXPECT_TRUE(loop.user().done()) << body.name << ", " << aimed;
      EXPECT_EQ(loop.user().tally().approaches_missed, 0u) << body.name << ", " << aimed;
      EXPECT_GE(max, 0.5) << body.name << ", " << aimed;
    }
  }
}

TEST(Operator, AimsElsewhereAfterAMissedApproach) {
  // Two long triangles side by side: so coarse that their points cannot exclude the gap between them.
  const double w = 0.02;
  std::vector<Triangle> bars;
  for (const double x : {-0.1, 0.1})
    bars.insert(bars.end(), {{Vec3d{x - w, -0.1, 0}, Vec3d{x + w, -0.1, 0}, Vec3d{x + w, 0.1, 0}},
                             {Vec3d{x - w, -0.1, 0}, Vec3d{x + w, 0.1, 0}, Vec3d{x - w, 0.1, 0}}});
  ClosedLoop loop{bars, user_with("      - approach: {object: body, direction: [0, 0, 1], until_force: 0.5}\n")};
  loop.publish_surface();
  double max = 0;
  loop.run(20, [&](double force, bool) { max = std::max(max, force); });
  EXPECT_TRUE(loop.user().done());
  EXPECT_EQ(loop.user().tally().approaches_missed, 1u);
  EXPECT_GE(max, 0.5);
}

TEST(Operator, AimsAtTheScriptedPointWhenTheSurfaceMayBeThere) {
  for (const Body& body : bodies()) {
    const auto touched = [&](bool published) {
      ClosedLoop loop{body.triangles, user_with("      - approach: {object: body, direction: [1, 1, 0.2], point: [0.5, "
                                                "0.6, 0.5], until_force: 0.5}\n")};
      if (published) loop.publish_surface();
      loop.run(10);
      return loop.proxy();
    };
    EXPECT_EQ(touched(true), touched(false)) << body.name;
  }
}

TEST(Operator, TransformsSurfacePointsByThePoseOfTheObject) {
  session::CatalogueEntry entry;
  entry.scale = 0.5;
  entry.pose.position = {1, 2, 3};
  entry.pose.orientation = {0, 0, std::sqrt(0.5), std::sqrt(0.5)};  // a quarter about z
  entry.surface = {{{{2, 0, 4}, {1, 0, 0}}}, 0.25};
  const ObjectView view = view_of(entry);
  ASSERT_EQ(view.surface.size(), 1u);
  EXPECT_LT((view.surface[0].position - Vec3d{1, 3, 5}).norm(), 1e-12);
  EXPECT_LT((view.surface[0].normal - Vec3d{0, 1, 0}).norm(), 1e-12);
  EXPECT_DOUBLE_EQ(view.spacing, 0.125);
}

TEST(Operator, TapsTheScriptedNumberOfTimesWithTheScriptedForce) {
  for (const double speed : {0.05, 0.2, 0.5}) {
    ClosedLoop loop{bodies()[1].triangles,
                    user_with("      - tap: {object: body, direction: [0, 1, 1], count: 5, speed: " +
                              std::to_string(speed) + ", force: 1}\n")};
    int onsets = 0;
    int cycles_in_the_air = 1000;
    double peak = 1;
    loop.run(30, [&](double force, bool contact) {
      if (contact && cycles_in_the_air > 20) {  // a bounce of the device's mass is not a new tap
        EXPECT_GE(peak, 1) << speed << " m/s";
        ++onsets;
        peak = 0;
      }
      cycles_in_the_air = contact ? 0 : cycles_in_the_air + 1;
      peak = std::max(peak, force);
    });
    EXPECT_TRUE(loop.user().done()) << speed << " m/s";
    EXPECT_EQ(loop.user().tally().taps, 5u) << speed << " m/s";
    EXPECT_EQ(onsets, 5) << speed << " m/s";
  }
}

TEST(Operator, StaysInContactWhileItFollowsAtTheScriptedSpeedAndForce) {
  for (const Body& body : bodies()) {
    for (const char* pattern : {"circle", "zigzag", "around"}) {
      for (const double friction : {0.0, 0.4}) {
        ClosedLoop loop{body.triangles,
                        user_with("      - follow: {object: body, direction: [0.2, -1, 0.5], speed: 0.05, force: 1.5, "
                                  "seconds: 10, pattern: " +
                                  std::string{pattern} + "}\n")};
        loop.set_friction(friction);
        int cycles = 0;
        int contact_cycles = 0;
        int in_band = 0;
        double sum = 0;
        loop.run(20, [&](double force, bool contact) {
          if (!loop.user().is_following()) return;
          ++cycles;
          if (contact) ++contact_cycles;
          if (force > 0.75 && force < 2.25) ++in_band;
          sum += force;
        });
        double length = 0;
        for (std::size_t i = 1; i < loop.path.size(); ++i) length += (loop.path[i] - loop.path[i - 1]).norm();
        SCOPED_TRACE(std::string{body.name} + " " + pattern + " friction " + std::to_string(friction));
        EXPECT_TRUE(loop.user().done());
        EXPECT_GT(cycles, 9000);
        EXPECT_GT(contact_cycles, 0.95 * cycles);
        EXPECT_GT(in_band, 0.9 * cycles);
        EXPECT_NEAR(sum / cycles, 1.5, 0.2);
        EXPECT_NEAR(length / (1e-3 * cycles), 0.05, 0.01);
        EXPECT_EQ(loop.user().tally().contacts_lost, 0u);
      }
    }
  }
}

TEST(Operator, FollowsOverTensOfMillisecondsOfNetwork) {
  ClosedLoop loop{bodies()[1].triangles,
                  user_with("      - follow: {object: body, speed: 0.05, force: 1.5, seconds: 8}\n"), 25'000'000};
  int cycles = 0;
  int contact_cycles = 0;
  loop.run(20, [&](double, bool contact) {
    if (!loop.user().is_following()) return;
    ++cycles;
    if (contact) ++contact_cycles;
  });
  EXPECT_TRUE(loop.user().done());
  EXPECT_GT(contact_cycles, 0.95 * cycles);
}

TEST(Operator, ReturnsToALostSurface) {
  // A sphere with its cap removed: a path along the rim falls off repeatedly.
  std::vector<Triangle> open;
  for (const Triangle& triangle : haptics::testing::sphere(0.1, 4)) {
    if ((triangle[0] + triangle[1] + triangle[2]).z() / 3 < 0.06) open.push_back(triangle);
  }
  ClosedLoop loop{open, user_with("      - follow: {object: body, direction: [1, 0, 0.3], speed: 0.05, force: 1.5, "
                                  "seconds: 15, pattern: circle, extent: 0.06}\n")};
  int cycles = 0;
  int contact_cycles = 0;
  loop.run(60, [&](double, bool contact) {
    if (!loop.user().is_following()) return;
    ++cycles;
    if (contact) ++contact_cycles;
  });
  EXPECT_TRUE(loop.user().done());
  EXPECT_GT(contact_cycles, 0.5 * cycles);
  EXPECT_GT(loop.user().tally().contacts_lost, 0u);
}

TEST(Operator, RetreatsOutOfTheBounds) {
  ClosedLoop loop{bodies()[1].triangles,
                  user_with("      - approach: {object: body, direction: [0, 1, 0.4]}\n      - hold: {seconds: 0.5, "
                            "force: 2}\n      - retreat: {speed: 0.2}\n")};
  bool contact_now = true;
  loop.run(20, [&](double, bool contact) { contact_now = contact; });
  EXPECT_TRUE(loop.user().done());
  EXPECT_FALSE(contact_now);
  EXPECT_GT(loop.proxy().cwiseAbs().maxCoeff(), 0.1);
}

TEST(Operator, GivesUpOnAnObjectThatIsNotInItsBounds) {
  using haptics::testing::operator+;
  std::vector<Triangle> name_conflict = haptics::testing::sphere(0.02, 2);
  for (Triangle& triangle : name_conflict) {
    for (Vec3d& corner : triangle) corner.x() += 0.2;
  }
  ClosedLoop loop{name_conflict + haptics::testing::sphere(0.02, 2),
                  user_with("      - approach: {object: body, speed: 0.3}\n")};
  loop.run(120);
  EXPECT_TRUE(loop.user().done());
  EXPECT_EQ(loop.user().tally().approaches_missed, 5u);
}

}  // namespace
}  // namespace tactus::client_sim
