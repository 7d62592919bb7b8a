#include "bench/tool_path.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "bench/surface_path.hpp"
#include "haptics/rigid_body.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/rotation.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kTwoPi = 2 * 3.14159265358979323846;
constexpr double kApproachTime = 1;        // s
constexpr double kStartHeight = 0.06;      // above the surface, m
constexpr double kWristTime = 0.25;        // time constant of the tool's axis, s
constexpr double kHandTime = 0.02;         // time constant of each of the hand's two filters, s
constexpr double kRound = 4, kRest = 0.8;  // s; each round ends with a rest
constexpr double kSettle = 0.4;            // s of a rest after which the device counts as resting

/// A smooth random function of time within [-1, 1]: a sum of three sines.
class Wave {
 public:
  Wave(std::mt19937_64& random, double min_hz, double max_hz) {
    std::uniform_real_distribution<double> phase{0, kTwoPi}, rate{std::log(min_hz), std::log(max_hz)};
    for (auto& [frequency, start] : sines_) {
      frequency = std::exp(rate(random));
      start = phase(random);
    }
  }
  [[nodiscard]] double at(double t) const {
    double sum = 0;
    for (const auto& [frequency, start] : sines_) sum += std::sin(kTwoPi * frequency * t + start);
    return sum / static_cast<double>(sines_.size());
  }

 private:
  std::array<std::pair<double, double>, 3> sines_;
};

}  // namespace

std::vector<ToolPathPose> tool_path(const LoadedModel& subject, const ToolPathSettings& settings) {
  const double unit = subject.model.summary.metres_per_unit;
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  std::mt19937_64 random{settings.seed};
  const double path_step = settings.speed * settings.period / 4;  // step of the surface path, m
  const std::vector<SurfacePose> along =
      surface_poses(subject.model.positions, subject.finest,
                    {settings.radius / unit, 0, path_step / unit, 4 * settings.poses + 8, settings.seed},
                    [&](const Vec3d& p) { return finest.distance(p); });
  const Wave speed_wave{random, 0.2, 1.5}, depth_wave{random, 0.1, 0.6}, tap_wave{random, 2, 6};
  const std::array<Wave, 3> tilts{Wave{random, 0.1, 0.6}, Wave{random, 0.1, 0.6}, Wave{random, 0.1, 0.6}};

  std::vector<ToolPathPose> path;
  path.reserve(settings.poses);
  double t = 0, steps = 0;  // time of the motion, without rests; distance along the surface path
  Vec3d upright = along.front().normal;
  Eigen::Quaterniond base = spm::rotation_between(Vec3d::UnitZ(), upright);
  std::array<haptics::ToolPose, 2> hand;  // the target pose after one and after two low-pass filters
  for (std::uint32_t i = 0; i < settings.poses; ++i) {
    // `t` slows down before a rest and stops during it.
    const double now = i * settings.period, since_rest_end = std::fmod(now, kRound);
    const double until_rest = kRound - kRest - since_rest_end;
    const double time_rate = now < kApproachTime ? 1 : std::clamp(std::min(until_rest, since_rest_end) / 0.1, 0.0, 1.0);
    t += time_rate * settings.period;
    const bool tapping = std::fmod(now, 3 * kRound) > 2 * kRound;
    const double speed = settings.speed * std::abs(speed_wave.at(t)) * (now < kApproachTime ? 0 : time_rate);
    steps = std::min(steps + speed * settings.period / path_step, static_cast<double>(along.size() - 2));
    const auto at = static_cast<std::size_t>(steps);
    const double fraction = steps - static_cast<double>(at);
    const Vec3d centre = unit * ((1 - fraction) * along[at].centre + fraction * along[at + 1].centre);
    const Vec3d normal = ((1 - fraction) * along[at].normal + fraction * along[at + 1].normal).normalized();
    // The tool's axis follows the normal at the speed of a wrist, without rotation about itself.
    const Vec3d previous = upright;
    upright = (upright + settings.period / kWristTime * (normal - upright)).normalized();
    base = (spm::rotation_between(previous, upright) * base).normalized();
    double depth = settings.depth * std::pow(depth_wave.at(t), 2) - (tapping ? 0.004 : 0.001);
    if (tapping) depth = -0.002 - 0.006 * tap_wave.at(t);
    if (now < kApproachTime) depth = -kStartHeight * (1 - now / kApproachTime) + depth * now / kApproachTime;
    const double lean = now < kApproachTime ? now / kApproachTime : 1;
    const Vec3d rotation = settings.lean * lean * Vec3d{tilts[0].at(t), tilts[1].at(t), 2 * tilts[2].at(t)};
    const Eigen::Quaterniond orientation = base * haptics::exp_map(rotation);
    const haptics::ToolPose target{centre - depth * upright, orientation};
    if (i == 0) hand.fill(target);
    const haptics::ToolPose* from = &target;
    for (haptics::ToolPose& stage : hand) {
      const double gain = settings.period / kHandTime;
      stage.position += gain * (from->position - stage.position);
      stage.orientation = stage.orientation.slerp(gain, from->orientation).normalized();
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
