/// What the benchmarks of prediction and of swift motion have in common: a model at a hand's scale and a hand that
/// comes from the air and strokes it.
#pragma once

#include <cmath>
#include <vector>

#include "bench/models.hpp"
#include "bench/surface_path.hpp"
#include "spm/finest_tree.hpp"

namespace tactus::bench {

constexpr double kBand = 3;             ///< Hz, of the path's curvature
constexpr double kBendRadius = 0.1;     ///< m, rms
constexpr double kTipRadius = 0.003;    ///< m, of the tip
constexpr double kPressDepth = 0.0002;  ///< m

/// A generated organ, or a file, with a mean edge of kHandEdge.
struct StrokedModel {
  LoadedModel subject;
  spm::FinestTree finest;
  double unit;  ///< metres per unit

  StrokedModel(const std::string& path, std::uint32_t faces)
      : subject{[&] {
          LoadedModel loaded = load_model(path, faces);
          scale_to_edge(loaded, kHandEdge);
          return loaded;
        }()},
        finest{subject.model.positions, subject.finest},
        unit{subject.model.summary.metres_per_unit} {}

  /// World frame: the model's, in metres.
  [[nodiscard]] spm::Vec3d nearest(const spm::Vec3d& point) const {
    spm::NearestFace found;
    static_cast<void>(finest.tree().nearest(point / unit, 1e12, found));
    return found.point * unit;
  }
  [[nodiscard]] double distance(const spm::Vec3d& point) const { return (point - nearest(point)).norm(); }
};

/// The same way with poses `step` apart, however it winds.
[[nodiscard]] inline std::vector<spm::Vec3d> evenly(const std::vector<spm::Vec3d>& way, double step) {
  std::vector<spm::Vec3d> poses{way.front()};
  double left = step;
  for (std::size_t i = 1; i < way.size(); ++i) {
    spm::Vec3d from = way[i - 1];
    for (double length = (way[i] - from).norm(); length >= left; length = (way[i] - from).norm()) {
      from += (way[i] - from) * (left / length);
      poses.push_back(from);
      left = step;
    }
    left -= (way[i] - from).norm();
  }
  return poses;
}

/// From 5 cm above the model's highest vertex straight down, then a hand's strokes, the tip at `speed` all the time; m.
[[nodiscard]] inline std::vector<spm::Vec3d> surface_motion(const StrokedModel& model, double speed, double height,
                                                            std::uint32_t poses, std::uint64_t seed) {
  constexpr double kFrom = 0.05;  // m
  spm::Vec3d top = spm::Vec3d::Constant(-1e300);
  for (const std::array<float, 3>& p : model.subject.model.positions)
    if (p[2] > top[2]) top = {p[0], p[1], p[2]};
  const double unit = model.unit;
  const HandPathSettings settings{kTipRadius / unit,
                                  kPressDepth / unit,
                                  speed / unit,
                                  kBendRadius / unit,
                                  kBand,
                                  0.001,
                                  height / unit,
                                  poses,
                                  seed};
  std::vector<spm::Vec3d> hand =
      hand_path(model.subject.model.positions, top + settings.radius * spm::Vec3d::UnitZ(), settings,
                [&](const spm::Vec3d& point) -> spm::Vec3d { return model.nearest(point * unit) / unit; });
  for (spm::Vec3d& tip : hand) tip *= unit;
  std::vector<spm::Vec3d> path;
  for (double left = kFrom; left > 0; left -= speed * settings.period)
    path.push_back(hand.front() + left * spm::Vec3d::UnitZ());
  const std::vector<spm::Vec3d> even = evenly(hand, speed * settings.period);
  path.insert(path.end(), even.begin(), even.end());
  path.resize(std::min<std::size_t>(path.size(), poses));
  return path;
}

}  // namespace tactus::bench
