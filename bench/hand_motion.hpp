/// A model at a hand's scale, and the path of a hand that approaches and strokes the model, for the benchmarks of
/// prediction and of swift motion.
#pragma once

#include <cmath>
#include <vector>

#include "bench/models.hpp"
#include "bench/surface_path.hpp"
#include "spm/finest_tree.hpp"

namespace tactus::bench {

constexpr double kBand = 3;             ///< bandwidth of the path's curvature, Hz
constexpr double kBendRadius = 0.1;     ///< m; 1 divided by the root mean square of the path's curvature
constexpr double kTipRadius = 0.003;    ///< m
constexpr double kPressDepth = 0.0002;  ///< depth of the tip in the surface, m

/// A model file, or a generated organ, with a mean edge length of kHandEdge.
struct HandScaleModel {
  LoadedModel subject;
  spm::FinestTree finest;
  double unit;  ///< metres per unit

  HandScaleModel(const std::string& path, std::uint32_t faces)
      : subject{[&] {
          LoadedModel loaded = load_model(path, faces);
          scale_to_edge(loaded, kHandEdge);
          return loaded;
        }()},
        finest{subject.model.positions, subject.finest},
        unit{subject.model.summary.metres_per_unit} {}

  /// Returns the nearest point of the finest mesh. Model frame, metres.
  [[nodiscard]] spm::Vec3d nearest(const spm::Vec3d& point) const {
    spm::NearestFace found;
    static_cast<void>(finest.tree().nearest(point / unit, 1e12, found));
    return found.point * unit;
  }
  [[nodiscard]] double distance(const spm::Vec3d& point) const { return (point - nearest(point)).norm(); }
};

/// Returns points on the polyline `path` at equal distances of `step` along it.
[[nodiscard]] inline std::vector<spm::Vec3d> resample(const std::vector<spm::Vec3d>& path, double step) {
  std::vector<spm::Vec3d> poses{path.front()};
  double left = step;
  for (std::size_t i = 1; i < path.size(); ++i) {
    spm::Vec3d from = path[i - 1];
    for (double length = (path[i] - from).norm(); length >= left; length = (path[i] - from).norm()) {
      from += (path[i] - from) * (left / length);
      poses.push_back(from);
      left = step;
    }
    left -= (path[i] - from).norm();
  }
  return poses;
}

/// Returns the path of a tip at constant `speed` (m/s): one position (m) for each cycle of 1 ms. The tip moves down
/// from 5 cm above the model's highest vertex and then strokes the surface. `height`: HandPathSettings::height, m.
[[nodiscard]] inline std::vector<spm::Vec3d> surface_motion(const HandScaleModel& model, double speed, double height,
                                                            std::uint32_t poses, std::uint64_t seed) {
  constexpr double kStartHeight = 0.05;  // m
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
  for (double left = kStartHeight; left > 0; left -= speed * settings.period)
    path.push_back(hand.front() + left * spm::Vec3d::UnitZ());
  const std::vector<spm::Vec3d> resampled = resample(hand, speed * settings.period);
  path.insert(path.end(), resampled.begin(), resampled.end());
  path.resize(std::min<std::size_t>(path.size(), poses));
  return path;
}

}  // namespace tactus::bench
