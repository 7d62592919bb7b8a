#include "tests/haptics/random_motions.hpp"

#include <algorithm>
#include <random>

#include "haptics/proxy.hpp"
#include "tests/haptics/moving_bodies.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics::testing {
namespace {

constexpr double kRadius = 0.003;

/// A block with a top of 0.05 m x 0.05 m and a groove along y. Width and depth of the groove are `width`.
std::vector<Triangle> grooved(double width) {
  constexpr double kHalf = 0.025;
  // Clockwise seen along y. Every corner is visible from the first, the bottom of the groove.
  const std::vector<Vec3d> outline{{0, 0, -width},      {width / 2, 0, 0}, {kHalf, 0, 0},     {kHalf, 0, -kHalf},
                                   {-kHalf, 0, -kHalf}, {-kHalf, 0, 0},    {-width / 2, 0, 0}};
  const Vec3d along{0, kHalf, 0};
  std::vector<Triangle> triangles;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vec3d& a = outline[i];
    const Vec3d& b = outline[(i + 1) % outline.size()];
    triangles = triangles + sheet(a - along, b - a, 2 * along);
    if (i == 0 || i + 1 == outline.size()) continue;
    triangles.push_back({outline[0] - along, b - along, a - along});
    triangles.push_back({outline[0] + along, a + along, b + along});
  }
  return triangles;
}

/// A box of thin walls around the tip: two closed surfaces, 10 um apart.
MotionBody shell() {
  constexpr double kHalf = 0.03, kWall = 1e-5;
  return {box(kHalf) + box(kHalf - kWall, true), box(kHalf), 1};
}

MotionBody moving(MotionBody body, double speed, double angular_speed) {
  body.speed = speed;
  body.angular_speed = angular_speed;
  return body;
}

/// A random walk with smooth changes of direction and speed, within a range around the origin.
class RandomWalk {
 public:
  RandomWalk(double max_speed, double range, std::mt19937_64& random)
      : max_speed_{max_speed}, range_{range}, random_{random} {}
  /// Returns the displacement of a cycle that begins at `position`.
  Vec3d step(const Vec3d& position) {
    std::normal_distribution<double> normal;
    heading_ += 0.1 * Vec3d{normal(random_), normal(random_), normal(random_)};
    if (position.norm() > range_) heading_ -= 0.1 * position.normalized();
    heading_.normalize();
    speed_share_ = std::clamp(speed_share_ + 0.05 * normal(random_), 0.0, 1.0);
    return heading_ * (speed_share_ * max_speed_ * kCycle);
  }

 private:
  double max_speed_, range_;
  std::mt19937_64& random_;
  Vec3d heading_ = -Vec3d::UnitZ();
  double speed_share_ = 0.5;
};

class MotionRun {
 public:
  MotionRun(const MotionScene& scene, double friction, std::uint64_t seed, bool reported)
      : scene_{scene}, random_{seed}, reported_{reported} {
    for (const MotionBody& body : scene.bodies) {
      bodies_.add(body.triangles);
      walks_.emplace_back(body.speed, kBodyRange, random_);
      rotations_.emplace_back(Vec3d::UnitZ(), Eigen::Quaterniond::Identity());
    }
    proxy_.set_grip({friction, 0.7 * friction});
  }

  MotionResult run(std::uint64_t motions) {
    Vec3d hand = scene_.start;
    RandomWalk hand_walk{scene_.hand_speed, scene_.range, random_};
    bodies_.start_step();
    (void)proxy_.step(hand, kCycle, bodies_, false);
    for (; result_.motions < motions && result_.passed == 0; ++result_.motions) {
      hand += hand_walk.step(hand);
      move_bodies();
      const bool was_outside_only = proxy_.last().outside_only;
      const ProxyResult& touch = proxy_.step(hand, kCycle, bodies_, false);
      if (touch.in_contact) ++result_.contacts;
      if (touch.in_contact && touch.surface_velocity.norm() > 0) ++result_.pushed;
      if (touch.outside_only) {
        if (!was_outside_only) ++result_.crushed;
        if (!scene_.may_crush) record_pass("the proxy touches nothing any more");
        continue;
      }
      check_sides(touch.proxy);
    }
    return result_;
  }

 private:
  static constexpr double kBodyRange = 0.03;          // m; distance from the origin at which a body turns back
  static constexpr std::uint64_t kPhaseCycles = 300;  // a phase of rest and a phase of motion alternate

  void move_bodies() {
    bodies_.start_step();
    if (result_.motions / kPhaseCycles % 2 == 0) return;
    std::normal_distribution<double> normal;
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      const MotionBody& body = scene_.bodies[i];
      if (!(body.speed > 0)) continue;
      auto& [axis, orientation] = rotations_[i];
      axis = (axis + 0.1 * Vec3d{normal(random_), normal(random_), normal(random_)}).normalized();
      orientation = (Eigen::AngleAxisd{body.angular_speed * kCycle, axis} * orientation).normalized();
      const Vec3d position = bodies_.pose(i).position;
      bodies_.move(i, {orientation.toRotationMatrix(), position + walks_[i].step(position)});
    }
    if (!reported_) bodies_.start_step();  // hides the motion
  }

  void record_pass(const std::string& reason) {
    ++result_.passed;
    result_.what = reason + " at motion " + std::to_string(result_.motions);
  }

  void check_sides(const Vec3d& proxy) {
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      const MotionBody& body = scene_.bodies[i];
      const Vec3d proxy_body = bodies_.pose(i).to_body(proxy);
      const double winding = winding_number(proxy_body, body.walls.empty() ? body.triangles : body.walls);
      if (std::abs(winding - body.winding) > 0.5) record_pass("winding number " + std::to_string(winding));
    }
    SurfaceHit hit;
    if (bodies_.closest(proxy, kRadius, hit))
      result_.deepest = std::max(result_.deepest, kRadius - std::abs(hit.distance));
  }

  const MotionScene& scene_;
  std::mt19937_64 random_;
  bool reported_;
  MovingBodies bodies_;
  std::vector<RandomWalk> walks_;
  std::vector<std::pair<Vec3d, Eigen::Quaterniond>> rotations_;  // axis and orientation by body
  Proxy proxy_;
  MotionResult result_;
};

}  // namespace

std::vector<Triangle> box(double half, bool inwards) {
  std::vector<Triangle> triangles;
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0}) {
      Vec3d centre = Vec3d::Zero(), u = Vec3d::Zero();
      centre[axis] = side * half;
      u[(axis + 1) % 3] = half;
      const Vec3d v = centre.cross(u) / half;
      triangles = triangles + sheet(centre - u - v, 2 * u, 2 * v);
    }
  if (inwards)
    for (Triangle& t : triangles) std::swap(t[1], t[2]);
  return triangles;
}

std::vector<MotionScene> motion_scenes() {
  const MotionBody round{sphere(0.05, 2)}, rock{bumpy(0.05, 2, 0.25)}, groove{grooved(0.01)}, crack{grooved(0.004)};
  const MotionBody spike{tetrahedron(0.05)}, cube{box(0.02)};
  std::vector<Triangle> floor = box(0.1);  // the moving box sometimes reaches the upper side of the floor
  for (Triangle& t : floor)
    for (Vec3d& corner : t) corner.z() -= 0.13;
  constexpr double kSmallRange = 0.05;
  return {{"sphere", {round}},
          {"rock", {rock}},
          {"spike", {spike}},
          {"groove", {groove}, {0.01, 0.01, 0.03}, kSmallRange},
          {"crack narrower than the tip", {crack}, {0.01, 0.01, 0.03}, kSmallRange},
          {"thin shell around the tip", {shell()}, Vec3d::Zero(), kSmallRange},
          {"moving sphere", {moving(round, 1, 5)}},
          {"moving rock", {moving(rock, 1, 10)}},
          {"moving spike", {moving(spike, 1, 10)}},
          {"moving groove", {moving(groove, 1, 10)}, {0.01, 0.01, 0.03}, kSmallRange},
          {"moving shell around the tip", {moving(shell(), 1, 5)}, Vec3d::Zero(), kSmallRange},
          {"rock that moves by more than the tip's radius per cycle", {moving(rock, 10, 30)}},
          {"shell that moves by more than the tip's radius per cycle",
           {moving(shell(), 10, 30)},
           Vec3d::Zero(),
           kSmallRange},
          {"box over a floor", {moving(cube, 1, 10), {floor}}, {0.02, -0.01, 0.12}, 0.06, 1, true}};
}

MotionResult run_motions(const MotionScene& scene, std::uint64_t motions, double friction, std::uint64_t seed,
                         bool reported) {
  return MotionRun{scene, friction, seed, reported}.run(motions);
}

}  // namespace tactus::haptics::testing
