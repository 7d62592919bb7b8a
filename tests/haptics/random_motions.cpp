#include "tests/haptics/random_motions.hpp"

#include <algorithm>
#include <random>

#include "haptics/proxy.hpp"
#include "tests/haptics/moving_bodies.hpp"

namespace tactus::haptics::testing {
namespace {

constexpr double kCycle = 1e-3;
constexpr double kRadius = 0.003;

/// A block whose 0.05 m wide top has a groove along y, as wide as it is deep.
std::vector<Triangle> grooved(double width) {
  constexpr double kHalf = 0.025;
  // Clockwise seen along y; star-shaped about the bottom of the groove, which comes first.
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

MotionBody moving(MotionBody body, double speed, double turning) {
  body.speed = speed;
  body.turning = turning;
  return body;
}

/// A random direction and a random speed.
class Wander {
 public:
  Wander(double max, double range, std::mt19937_64& random) : max_{max}, range_{range}, random_{random} {}
  Vec3d step(const Vec3d& at) {
    std::normal_distribution<double> normal;
    heading_ += 0.1 * Vec3d{normal(random_), normal(random_), normal(random_)};
    if (at.norm() > range_) heading_ -= 0.1 * at.normalized();
    heading_.normalize();
    share_ = std::clamp(share_ + 0.05 * normal(random_), 0.0, 1.0);
    return heading_ * (share_ * max_ * kCycle);
  }

 private:
  double max_, range_;
  std::mt19937_64& random_;
  Vec3d heading_ = -Vec3d::UnitZ();
  double share_ = 0.5;
};

class MotionRun {
 public:
  MotionRun(const MotionScene& scene, double friction, std::uint64_t seed, bool reported)
      : scene_{scene}, random_{seed}, reported_{reported} {
    for (const MotionBody& body : scene.bodies) {
      bodies_.add(body.triangles);
      ways_.emplace_back(body.speed, kBodyRange, random_);
      turns_.emplace_back(Vec3d::UnitZ(), Eigen::Quaterniond::Identity());
    }
    proxy_.set_grip({friction, 0.7 * friction});
  }

  MotionResult run(std::uint64_t motions) {
    Vec3d hand = scene_.start;
    Wander way{scene_.hand_speed, scene_.range, random_};
    bodies_.rest();
    (void)proxy_.step(hand, kCycle, bodies_, false);
    for (; result_.motions < motions && result_.passed == 0; ++result_.motions) {
      hand += way.step(hand);
      move_bodies();
      const bool was_out = proxy_.last().outside_only;
      const ProxyResult& now = proxy_.step(hand, kCycle, bodies_, false);
      if (now.in_contact) ++result_.contacts;
      if (now.in_contact && now.surface_velocity.norm() > 0) ++result_.pushed;
      if (now.outside_only) {
        if (!was_out) ++result_.crushed;
        if (!scene_.may_crush) pass("touches nothing any more");
        continue;
      }
      check(now.proxy);
    }
    return result_;
  }

 private:
  static constexpr double kBodyRange = 0.03;    // m that a body strays from the origin
  static constexpr std::uint64_t kSpell = 300;  // steps of motion, then of rest

  void move_bodies() {
    bodies_.rest();
    if (result_.motions / kSpell % 2 == 0) return;
    std::normal_distribution<double> normal;
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      const MotionBody& body = scene_.bodies[i];
      if (!(body.speed > 0)) continue;
      auto& [axis, turned] = turns_[i];
      axis = (axis + 0.1 * Vec3d{normal(random_), normal(random_), normal(random_)}).normalized();
      turned = (Eigen::AngleAxisd{body.turning * kCycle, axis} * turned).normalized();
      const Vec3d at = bodies_.pose(i).position;
      bodies_.move(i, {turned.toRotationMatrix(), at + ways_[i].step(at)});
    }
    if (!reported_) bodies_.rest();
  }

  void pass(const std::string& how) {
    ++result_.passed;
    result_.what = how + " at motion " + std::to_string(result_.motions);
  }

  void check(const Vec3d& proxy) {
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      const MotionBody& body = scene_.bodies[i];
      const Vec3d at = bodies_.pose(i).to_body(proxy);
      const double winding = winding_number(at, body.walls.empty() ? body.triangles : body.walls);
      if (std::abs(winding - body.winding) > 0.5) pass("winding " + std::to_string(winding));
    }
    SurfaceHit hit;
    if (bodies_.closest(proxy, kRadius, hit))
      result_.deepest = std::max(result_.deepest, kRadius - std::abs(hit.distance));
  }

  const MotionScene& scene_;
  std::mt19937_64 random_;
  bool reported_;
  MovingBodies bodies_;
  std::vector<Wander> ways_;
  std::vector<std::pair<Vec3d, Eigen::Quaterniond>> turns_;
  Proxy proxy_;
  MotionResult result_;
};

}  // namespace

std::vector<Triangle> box(double half, bool inwards) {
  std::vector<Triangle> triangles;
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0}) {
      Vec3d out = Vec3d::Zero(), u = Vec3d::Zero();
      out[axis] = side * half;
      u[(axis + 1) % 3] = half;
      const Vec3d v = out.cross(u) / half;
      triangles = triangles + sheet(out - u - v, 2 * u, 2 * v);
    }
  if (inwards)
    for (Triangle& t : triangles) std::swap(t[1], t[2]);
  return triangles;
}

std::vector<MotionScene> motion_scenes() {
  const MotionBody round{sphere(0.05, 2)}, rock{bumpy(0.05, 2, 0.25)}, groove{grooved(0.01)}, crack{grooved(0.004)};
  const MotionBody spike{tetrahedron(0.05)}, cube{box(0.02)};
  std::vector<Triangle> floor = box(0.1);  // its upper side is where the box reaches at times
  for (Triangle& t : floor)
    for (Vec3d& corner : t) corner.z() -= 0.13;
  constexpr double kWithin = 0.05;
  return {{"ball", {round}},
          {"rock", {rock}},
          {"spike", {spike}},
          {"groove", {groove}, {0.01, 0.01, 0.03}, kWithin},
          {"crack narrower than the tip", {crack}, {0.01, 0.01, 0.03}, kWithin},
          {"thin shell from within, its corners", {shell()}, Vec3d::Zero(), kWithin},
          {"moving ball", {moving(round, 1, 5)}},
          {"moving rock", {moving(rock, 1, 10)}},
          {"moving spike", {moving(spike, 1, 10)}},
          {"moving groove", {moving(groove, 1, 10)}, {0.01, 0.01, 0.03}, kWithin},
          {"moving shell around the tip", {moving(shell(), 1, 5)}, Vec3d::Zero(), kWithin},
          {"rock faster than the tip is thick", {moving(rock, 10, 30)}},
          {"shell faster than the tip is thick", {moving(shell(), 10, 30)}, Vec3d::Zero(), kWithin},
          {"box over a floor", {moving(cube, 1, 10), {floor}}, {0.02, -0.01, 0.12}, 0.06, 1, true}};
}

MotionResult run_motions(const MotionScene& scene, std::uint64_t motions, double friction, std::uint64_t seed,
                         bool reported) {
  return MotionRun{scene, friction, seed, reported}.run(motions);
}

}  // namespace tactus::haptics::testing
