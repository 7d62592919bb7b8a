#include "bench/tool_path.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "bench/surface_path.hpp"
#include "haptics/rigid_body.hpp"
#include "spm/fcl/fixed_mesh.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kTurn = 2 * 3.14159265358979323846;
constexpr double kApproach = 1, kFrom = 0.06;             // s, m above the surface
constexpr double kWrist = 0.25, kHand = 0.02;             // s, of what smooths
constexpr double kRound = 4, kRest = 0.8, kSettle = 0.4;  // s; of each round the last part is rest

/// A smooth function of time within [-1, 1].
class Wave {
 public:
  Wave(std::mt19937_64& random, double slowest, double fastest) {
    std::uniform_real_distribution<double> phase{0, kTurn}, rate{std::log(slowest), std::log(fastest)};
    for (auto& [frequency, start] : parts_) {
      frequency = std::exp(rate(random));
      start = phase(random);
    }
  }
  [[nodiscard]] double at(double t) const {
    double sum = 0;
    for (const auto& [frequency, start] : parts_) sum += std::sin(kTurn * frequency * t + start);
    return sum / static_cast<double>(parts_.size());
  }

 private:
  std::array<std::pair<double, double>, 3> parts_;
};

}  // namespace

std::vector<ToolPathPose> tool_path(const LoadedModel& subject, const ToolPathSettings& settings) {
  const double unit = subject.model.summary.metres_per_unit;
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  std::mt19937_64 random{settings.seed};
  const double fine = settings.speed * settings.period / 4;  // of the walk
  const std::vector<SurfacePose> along =
      surface_poses(subject.model.positions, subject.finest,
                    {settings.radius / unit, 0, fine / unit, 4 * settings.poses + 8, settings.seed},
                    [&](const Vec3d& p) { return finest.distance(p); });
  const Wave pace{random, 0.2, 1.5}, press{random, 0.1, 0.6}, tap{random, 2, 6};
  const std::array<Wave, 3> leans{Wave{random, 0.1, 0.6}, Wave{random, 0.1, 0.6}, Wave{random, 0.1, 0.6}};

  std::vector<ToolPathPose> path;
  path.reserve(settings.poses);
  double t = 0, way = 0;
  Vec3d upright = along.front().normal;
  Eigen::Quaterniond base = Eigen::Quaterniond::FromTwoVectors(Vec3d::UnitZ(), upright);
  std::array<haptics::ToolPose, 2> hand;  // the wish, passed on twice
  for (std::uint32_t i = 0; i < settings.poses; ++i) {
    // In a rest time itself stands still, after running out.
    const double now = i * settings.period, in_round = std::fmod(now, kRound);
    const double until_rest = kRound - kRest - in_round, since_rest = in_round;
    const double flow = now < kApproach ? 1 : std::clamp(std::min(until_rest, since_rest) / 0.1, 0.0, 1.0);
    t += flow * settings.period;
    const bool tapping = std::fmod(now, 3 * kRound) > 2 * kRound;
    const double speed = settings.speed * std::abs(pace.at(t)) * (now < kApproach ? 0 : flow);
    way = std::min(way + speed * settings.period / fine, static_cast<double>(along.size() - 2));
    const auto at = static_cast<std::size_t>(way);
    const double part = way - static_cast<double>(at);
    const Vec3d centre = unit * ((1 - part) * along[at].centre + part * along[at + 1].centre);
    const Vec3d normal = ((1 - part) * along[at].normal + part * along[at + 1].normal).normalized();
    // What it leans on turns no faster than a wrist, and without twist.
    const Vec3d before = upright;
    upright = (upright + settings.period / kWrist * (normal - upright)).normalized();
    base = (Eigen::Quaterniond::FromTwoVectors(before, upright) * base).normalized();
    double depth = settings.depth * std::pow(press.at(t), 2) - (tapping ? 0.004 : 0.001);
    if (tapping) depth = -0.002 - 0.006 * tap.at(t);
    if (now < kApproach) depth = -kFrom * (1 - now / kApproach) + depth * now / kApproach;
    const double lean = now < kApproach ? now / kApproach : 1;
    const Vec3d turn = settings.lean * lean * Vec3d{leans[0].at(t), leans[1].at(t), 2 * leans[2].at(t)};
    const Eigen::Quaterniond orientation = base * haptics::exp_map(turn);
    const haptics::ToolPose wish{centre - depth * upright, orientation};
    if (i == 0) hand.fill(wish);
    const haptics::ToolPose* from = &wish;
    for (haptics::ToolPose& stage : hand) {
      const double share = settings.period / kHand;
      stage.position += share * (from->position - stage.position);
      stage.orientation = stage.orientation.slerp(share, from->orientation).normalized();
      from = &stage;
    }
    ToolPathPose pose;
    pose.device = hand.back();
    pose.at_rest = until_rest < -kSettle;
    path.push_back(pose);
  }
  return path;
}

}  // namespace tactus::bench
