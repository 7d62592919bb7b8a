#include "client_sim/operator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <utility>
#include <vector>

#include "haptics/device.hpp"
#include "haptics/force.hpp"
#include "haptics/simulated_device.hpp"
#include "sharing/hand_path.hpp"
#include "spm/surface_points.hpp"
#include "tests/haptics/triangle_surface.hpp"

namespace tactus::client_sim {
namespace {

using haptics::testing::Triangle;
using haptics::testing::TriangleSurface;

/// One user, one HRTC, one object, and a network with a delay in each direction, at 1 kHz in virtual time.
class ClosedLoop {
 public:
  ClosedLoop(std::vector<Triangle> triangles, User user, std::int64_t delay_ns = 5'000'000)
      : surface_{std::move(triangles)}, delay_ns_{delay_ns}, operator_{user, {}} {
    haptics::HandSettings hand;
    hand.start = {0.05, 0.1, 0.3};
    device_.emplace(hand);
    limits_.soft_start = 0;
    force_.emplace(limits_, device_->spec());
    haptics::ProxySettings proxy_settings;
    proxy_settings.radius = user.radius;
    proxy_ = haptics::Proxy{proxy_settings};
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

  /// Publishes points of the surface as a host does. Without this call the user knows only the bounds.
  void publish_surface() {
    spm::BaseMesh mesh{};
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

  /// Runs until the script ends, at most `seconds`. Calls `after_cycle` after every cycle.
  void run(double seconds, const std::function<void(double force, bool contact)>& after_cycle = {}) {
    const std::int64_t end = now_ns_ + static_cast<std::int64_t>(seconds * 1e9);
    for (; now_ns_ < end && !operator_.done(); now_ns_ += 1'000'000) {
      cycle();
      if (after_cycle) after_cycle(state_.force.norm(), state_.contact);
    }
  }

  void stop() { force_->latch(haptics::Fault::kEmergencyStop); }
  void reset() { force_->reset(); }
  [[nodiscard]] bool has_fault() const { return fault_ != haptics::Fault::kNone; }

  [[nodiscard]] const Operator& user() const { return operator_; }
  [[nodiscard]] const Vec3d& proxy() const { return proxy_.last().proxy; }
  [[nodiscard]] double seconds() const { return static_cast<double>(now_ns_) * 1e-9; }
  std::vector<Vec3d> followed_path;  ///< proxy positions while the user follows the surface

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
    const haptics::ForceResult& rendered = force_->step(touch, device, impedance, 0, 1e-3);
    state_.force = rendered.force;
    fault_ = rendered.fault;
    state_.contact = touch.in_contact;
    device_->write(state_.force);
    if (operator_.is_following()) followed_path.push_back(touch.proxy);

    session::ProbeState sample;
    sample.user_id = session::id_of(operator_.user().name);
    sample.session_time_ns = now_ns_;
    for (int axis = 0; axis < 3; ++axis) {
      sample.device.position[axis] = device.position[axis];
      sample.proxy[axis] = touch.proxy[axis];
      sample.force[axis] = state_.force[axis];
    }
    if (state_.contact) sample.status |= session::kInContact;
    if (has_fault()) sample.status |= session::kFault;
    states_.emplace_back(now_ns_ + delay_ns_, sample);
    while (!states_.empty() && states_.front().first <= now_ns_) {
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

TEST(Operator, StoresRecentStatesOfABoundedNumberOfOtherUsers) {
  Operator ann{user_with("      - wait: {seconds: 100}\n"), {}};
  const auto receive_others = [&](std::uint64_t users) {
    session::ProbeState other;
    for (other.user_id = 1; other.user_id <= users; ++other.user_id) ann.on_other_probe_state(other);
  };
  const auto receive_own = [&](std::int64_t session_time_ns) {
    session::ProbeState own;
    own.user_id = session::id_of("ann");
    own.session_time_ns = session_time_ns;
    ann.on_probe_state(own);
  };
  receive_others(100'000);
  EXPECT_EQ(ann.stored_others(), 256u);
  receive_own(1'000'000'000);
  EXPECT_EQ(ann.stored_others(), 0u);
  receive_others(3);
  receive_own(1'199'000'000);
  EXPECT_EQ(ann.stored_others(), 3u);
  receive_others(1);
  receive_own(1'200'000'000);
  EXPECT_EQ(ann.stored_others(), 1u) << "the states of two users are 200 ms old";
}

TEST(Operator, SendsNothingBeforeItsFirstProbeState) {
  Operator ann{user_with("      - wait: {seconds: 1}\n"), {}};
  EXPECT_FALSE(ann.tick(1'000'000'000, {}).has_value());
}

/// Sets the state of a probe at a table, whose surface has a height of 0.1 m. SI.
void touch_table(const std::array<double, 3>& position, std::int64_t now_ns, session::ProbeState& state) {
  state.session_time_ns = now_ns;
  state.device.position = position;
  const double depth = 0.1 - position[2];
  state.proxy = {position[0], position[1], std::max(position[2], 0.1)};
  state.force = {0, 0, std::max(0.0, 250 * depth)};
  state.status = depth > 0 ? session::kInContact : 0u;
}

TEST(Operator, TiltsWhileItFollowsAndReturnsUprightWithoutAStep) {
  Operator ann{user_with("      - follow: {object: body, seconds: 6, lean: 0.8}\n      - retreat: {}\n"), {}};
  ObjectView view;
  view.half_size = {0.1, 0.1, 0.1};
  session::ProbeState state;
  state.user_id = session::id_of("ann");
  const auto orientation_of = [](const session::Waypoint& waypoint) {
    const auto& q = waypoint.pose.orientation;
    return Eigen::Quaterniond{q[3], q[0], q[1], q[2]};
  };
  Eigen::Quaterniond previous = Eigen::Quaterniond::Identity();
  double max_tilt = 0, max_step = 0, max_ahead = 0, final_tilt = 0;  // rad
  for (std::int64_t now = 1'000'000'000; now < 14'000'000'000; now += 10'000'000) {
    const auto intent = ann.tick(now, {{"body", view}});
    if (!intent) continue;
    const Eigen::Quaterniond orientation = orientation_of(intent->path[0]);
    max_step = std::max(max_step, orientation.angularDistance(previous));
    final_tilt = orientation.angularDistance(Eigen::Quaterniond::Identity());
    max_tilt = std::max(max_tilt, final_tilt);
    previous = orientation;
    if (intent->path.size() > 1)
      max_ahead = std::max(max_ahead, orientation_of(intent->path[1]).angularDistance(orientation));
    touch_table(intent->path[0].pose.position, now, state);
    ann.on_probe_state(state);
  }
  EXPECT_TRUE(ann.done());
  EXPECT_GT(max_tilt, 0.8);
  EXPECT_LT(max_tilt, 0.8 * std::sqrt(6.0));  // rotations about three axes, about the last one by twice the angle
  EXPECT_LT(max_step, 0.1);
  EXPECT_LT(max_ahead, 0.4);
  EXPECT_LT(final_tilt, 0.05);
}

TEST(Operator, CountsAHoldThatIsLostWhileItWaits) {
  enum class Without { kNone, kEvenStates, kOddStates, kAllStates };  // states that do not show the hold
  for (const Without without : {Without::kNone, Without::kEvenStates, Without::kOddStates, Without::kAllStates}) {
    SCOPED_TRACE(static_cast<int>(without));
    Operator ann{user_with("      - grab: {object: body}\n      - wait: {seconds: 1}\n      - release: {}\n"), {}};
    ObjectView view;
    view.half_size = {0.1, 0.1, 0.1};
    session::ProbeState state;
    state.user_id = session::id_of("ann");
    int pressed_ticks = 0;
    for (std::int64_t now = 1'000'000'000; now < 20'000'000'000 && !ann.done(); now += 10'000'000) {
      const auto intent = ann.tick(now, {{"body", view}});
      if (!intent) continue;
      touch_table(intent->path[0].pose.position, now, state);
      if ((intent->buttons & haptics::kGrabButton) != 0) {
        ++pressed_ticks;
        const bool is_lost = without == Without::kAllStates ||
                             without == (pressed_ticks % 2 == 0 ? Without::kEvenStates : Without::kOddStates);
        if (pressed_ticks <= 50 || !is_lost) state.status |= session::kHolding;
      }
      ann.on_probe_state(state);
    }
    EXPECT_TRUE(ann.done());
    EXPECT_EQ(ann.tally().grabs, 1u);
    EXPECT_EQ(ann.tally().grabs_lost, without == Without::kAllStates ? 1u : 0u);
  }
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
    double final_force = 0;
    loop.run(10, [&](double force, bool) { final_force = force; });
    EXPECT_TRUE(loop.user().done()) << body.name;
    EXPECT_GE(final_force, 0.4) << body.name;
    EXPECT_LT(final_force, 2) << body.name;
    EXPECT_GT(loop.proxy().dot(Vec3d(1, 1, 0.2).normalized()), 0.08) << body.name;
  }
}

TEST(Operator, DoesNotMoveDuringAStopAndContinuesAfterTheReset) {
  for (const Body& body : bodies())
    for (const double stopped_after : {0.5, 1.0, 1.6, 3.0}) {  // s: in the approach, at first contact, in the hold
      SCOPED_TRACE(std::string{body.name} + " " + std::to_string(stopped_after));
      ClosedLoop loop{body.triangles, user_with("      - approach: {object: body, direction: [0, 0, 1], speed: 0.2}\n"
                                                "      - hold: {seconds: 30, force: 1}\n")};
      loop.run(stopped_after);
      loop.stop();
      loop.run(4);
      loop.reset();
      double final_force = 0;
      bool faulted = false;
      loop.run(6, [&](double force, bool) {
        faulted = faulted || loop.has_fault();
        final_force = force;
      });
      EXPECT_FALSE(faulted) << "the force accelerated the hand until a fault";
      EXPECT_GT(final_force, 0.5);
    }
}

/// A tube around a polyline. `closed`: the last point is connected to the first one.
std::vector<Triangle> tube(const std::vector<Vec3d>& line, double radius, bool closed) {
  constexpr int kSides = 8;
  const int count = static_cast<int>(line.size());
  const auto point = [&](int i) { return line[static_cast<std::size_t>((i + count) % count)]; };
  const auto corner = [&](int i, int side) {
    const Vec3d tangent =
        (closed || i + 1 < count ? point(i + 1) : point(i)) - (closed || i > 0 ? point(i - 1) : point(i));
    const Vec3d normal = tangent.unitOrthogonal();
    const Vec3d binormal = tangent.normalized().cross(normal);
    const double angle = 2 * M_PI * side / kSides;
    return Vec3d{point(i) + radius * (std::cos(angle) * normal + std::sin(angle) * binormal)};
  };
  std::vector<Triangle> triangles;
  for (int i = 0; i < (closed ? count : count - 1); ++i) {
    for (int side = 0; side < kSides; ++side) {
      const Vec3d first = corner(i, side), second = corner(i, side + 1);
      const Vec3d next_first = corner((i + 1) % count, side), next_second = corner((i + 1) % count, side + 1);
      triangles.push_back({first, second, next_first});
      triangles.push_back({second, next_second, next_first});
    }
  }
  return triangles;
}

/// Thin bodies, whose bounds are mostly empty.
std::vector<Body> thin_bodies() {
  std::vector<Vec3d> ring, corner, rod;
  for (int i = 0; i < 60; ++i) ring.push_back(0.1 * Vec3d{std::cos(0.1047197551 * i), std::sin(0.1047197551 * i), 0});
  for (int i = 10; i > 0; --i) corner.push_back({0.02 * i, 0, 0});
  for (int i = 0; i <= 10; ++i) corner.push_back({0, 0.02 * i, 0});
  for (int i = 0; i <= 30; ++i) rod.push_back(0.007 * i * Vec3d{1, 0.8, 0.3});
  return {{"ring", tube(ring, 0.004, true)}, {"L", tube(corner, 0.005, false)}, {"rod", tube(rod, 0.003, false)}};
}

TEST(Operator, TouchesABodyWhoseBoundsAreMostlyEmpty) {
  for (const Body& body : thin_bodies()) {
    for (const char* aim :
         {"direction: [0, 0, 1]", "direction: [0.5, -0.3, 1]", "direction: [0, 0.2, 1], point: [0.7, 0.4, 0.5]"}) {
      ClosedLoop loop{body.triangles, user_with("      - approach: {object: body, " + std::string{aim} +
                                                ", speed: 0.1, until_force: 0.5}\n")};
      loop.publish_surface();
      double max_force = 0;
      loop.run(20, [&](double force, bool) { max_force = std::max(max_force, force); });
      EXPECT_TRUE(loop.user().done()) << body.name << ", " << aim;
      EXPECT_EQ(loop.user().tally().approaches_missed, 0u) << body.name << ", " << aim;
      EXPECT_GE(max_force, 0.5) << body.name << ", " << aim;
    }
  }
}

TEST(Operator, AimsAtAnotherPointAfterAMissedApproach) {
  // Two bars with a gap between them. The triangles are so coarse that the surface points do not show the gap.
  constexpr double kHalfWidth = 0.02;  // m
  std::vector<Triangle> bars;
  for (const double x : {-0.1, 0.1})
    bars.insert(bars.end(),
                {{Vec3d{x - kHalfWidth, -0.1, 0}, Vec3d{x + kHalfWidth, -0.1, 0}, Vec3d{x + kHalfWidth, 0.1, 0}},
                 {Vec3d{x - kHalfWidth, -0.1, 0}, Vec3d{x + kHalfWidth, 0.1, 0}, Vec3d{x - kHalfWidth, 0.1, 0}}});
  ClosedLoop loop{bars, user_with("      - approach: {object: body, direction: [0, 0, 1], until_force: 0.5}\n")};
  loop.publish_surface();
  double max_force = 0;
  loop.run(20, [&](double force, bool) { max_force = std::max(max_force, force); });
  EXPECT_TRUE(loop.user().done());
  EXPECT_EQ(loop.user().tally().approaches_missed, 1u);
  EXPECT_GE(max_force, 0.5);
}

TEST(Operator, AimsAtTheScriptedPointIfTheSurfaceMayBeThere) {
  for (const Body& body : bodies()) {
    const auto touched_point = [&](bool published) {
      ClosedLoop loop{body.triangles, user_with("      - approach: {object: body, direction: [1, 1, 0.2], point: [0.5, "
                                                "0.6, 0.5], until_force: 0.5}\n")};
      if (published) loop.publish_surface();
      loop.run(10);
      return loop.proxy();
    };
    EXPECT_EQ(touched_point(true), touched_point(false)) << body.name;
  }
}

TEST(Operator, TransformsSurfacePointsByThePoseOfTheObject) {
  session::CatalogueEntry entry;
  entry.scale = 0.5;
  entry.pose.position = {1, 2, 3};
  entry.pose.orientation = {0, 0, std::sqrt(0.5), std::sqrt(0.5)};  // 90 degrees about z
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
    int cycles_without_contact = 1000;
    double peak_force = 1;
    loop.run(30, [&](double force, bool contact) {
      if (contact && cycles_without_contact > 20) {  // after a shorter time the device has bounced
        EXPECT_GE(peak_force, 1) << speed << " m/s";
        ++onsets;
        peak_force = 0;
      }
      cycles_without_contact = contact ? 0 : cycles_without_contact + 1;
      peak_force = std::max(peak_force, force);
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
        int cycles_near_force = 0;
        double force_sum = 0;
        loop.run(20, [&](double force, bool contact) {
          if (!loop.user().is_following()) return;
          ++cycles;
          if (contact) ++contact_cycles;
          if (force > 0.75 && force < 2.25) ++cycles_near_force;
          force_sum += force;
        });
        double length = 0;
        for (std::size_t i = 1; i < loop.followed_path.size(); ++i)
          length += (loop.followed_path[i] - loop.followed_path[i - 1]).norm();
        SCOPED_TRACE(std::string{body.name} + " " + pattern + " friction " + std::to_string(friction));
        EXPECT_TRUE(loop.user().done());
        EXPECT_GT(cycles, 9000);
        EXPECT_GT(contact_cycles, 0.95 * cycles);
        EXPECT_GT(cycles_near_force, 0.9 * cycles);
        EXPECT_NEAR(force_sum / cycles, 1.5, 0.2);
        EXPECT_NEAR(length / (1e-3 * cycles), 0.05, 0.01);
        EXPECT_EQ(loop.user().tally().contacts_lost, 0u);
      }
    }
  }
}

TEST(Operator, StaysInContactWithADelayOf25Milliseconds) {
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
  // A sphere without its cap: a path along the rim leaves the surface repeatedly.
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

TEST(Operator, RetreatsOutOfTheBoundsOfTheObject) {
  ClosedLoop loop{bodies()[1].triangles,
                  user_with("      - approach: {object: body, direction: [0, 1, 0.4]}\n      - hold: {seconds: 0.5, "
                            "force: 2}\n      - retreat: {speed: 0.2}\n")};
  bool in_contact = true;
  loop.run(20, [&](double, bool contact) { in_contact = contact; });
  EXPECT_TRUE(loop.user().done());
  EXPECT_FALSE(in_contact);
  EXPECT_GT(loop.proxy().cwiseAbs().maxCoeff(), 0.1);
}

TEST(Operator, RetreatsFromTheFarSideWithoutPressing) {
  // The pattern leads half around a sphere with a radius of 0.1 m.
  ClosedLoop loop{
      bodies()[0].triangles,
      user_with("      - follow: {object: body, direction: [0, 1, 0], pattern: around, speed: 0.1, force: 0.8, "
                "seconds: 3.1}\n      - retreat: {}\n")};
  double max_force = 0;
  bool in_contact = true;
  loop.run(20, [&](double force, bool contact) {
    if (!loop.followed_path.empty() && !loop.user().is_following()) max_force = std::max(max_force, force);
    in_contact = contact;
  });
  EXPECT_TRUE(loop.user().done());
  EXPECT_LT(loop.proxy().y(), -0.05) << "the path ends on the far side";
  EXPECT_FALSE(in_contact);
  EXPECT_LT(max_force, 1.5);
}

TEST(Operator, EndsItsApproachAfterFiveMisses) {
  using haptics::testing::operator+;
  // Two small spheres: the centre of their bounds, at which the user aims, is empty.
  std::vector<Triangle> displaced = haptics::testing::sphere(0.02, 2);
  for (Triangle& triangle : displaced) {
    for (Vec3d& corner : triangle) corner.x() += 0.2;
  }
  ClosedLoop loop{displaced + haptics::testing::sphere(0.02, 2),
                  user_with("      - approach: {object: body, speed: 0.3}\n")};
  loop.run(120);
  EXPECT_TRUE(loop.user().done());
  EXPECT_EQ(loop.user().tally().approaches_missed, 5u);
}

}  // namespace
}  // namespace tactus::client_sim
