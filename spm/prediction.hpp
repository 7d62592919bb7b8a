/// Predicts which regions a probe will touch and when, so that the loader can load them in time.
///
/// Each strategy predicts spheres with times. The time to contact of a region is the time of the earliest sphere that
/// intersects the region. All strategies but the mixture are from the paper. We differ: the history consists of tip
/// positions instead of regions, because regions are too coarse for extrapolation at 1 kHz. `scripts/bench prediction`
/// reports how many regions each strategy loads in time and in vain.
///
/// Model frame, file units, seconds. Fixed memory. One thread, not the haptic one. A prediction takes about 10 us. The
/// mixture in contact takes some 50 us, and a few hundred with a look-ahead of 0.15 s.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (prediction of contact regions).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/motion_segment.hpp"
#include "spm/probe_spheres.hpp"
#include "spm/region_grid.hpp"
#include "spm/region_table.hpp"

namespace tactus::spm {

enum class Strategy : std::uint8_t {
  kNeighbours,  ///< regions around the tip, within the distance that the tip covers at its speed
  kLinear,      ///< regions along the path that the tip would take at constant velocity
  kPolynomial,  ///< regions along the path that the tip would take at constant acceleration
  kDistance,    ///< regions around the tip, within half the distance that the tip covers at its speed
  kMixture      ///< on a surface: MotionSegment's path, linear and polynomial; elsewhere: linear and distance
};
/// Names of the strategies for users, by Strategy.
inline constexpr std::array<const char*, 5> kStrategyNames{"neighbours", "linear", "polynomial", "distance", "mixture"};

struct PredictedRegion {
  RegionId region{};
  double time_to_contact = 0;   ///< s; 0 if the region is touched now
  double contact_end = 0;       ///< latest predicted time of contact, s
  double sigmas_from_path = 0;  ///< distance from the tip on its predicted path, in units of MotionSegment::rms_error

  [[nodiscard]] bool precedes(const PredictedRegion& other) const noexcept {
    return time_to_contact != other.time_to_contact ? time_to_contact < other.time_to_contact
                                                    : index(region) < index(other.region);
  }
  void merge(const PredictedRegion& other) noexcept {
    time_to_contact = std::min(time_to_contact, other.time_to_contact);
    contact_end = std::max(contact_end, other.contact_end);
    sigmas_from_path = std::min(sigmas_from_path, other.sigmas_from_path);
  }
};

struct PredictionSettings {
  double radius = 0;     ///< radius of the tip, file units
  double margin = 0;     ///< distance by which the predicted spheres exceed the tip, file units
  double min_speed = 0;  ///< speed that the prediction assumes for a slower tip, file units/s
  Strategy strategy = Strategy::kMixture;
};

class Predictor {
 public:
  /// Predicted regions. After `sort`, the smallest time to contact comes first. If there are more regions than fit,
  /// those with the largest times are dropped.
  struct Regions : RegionTable<PredictedRegion> {
    static constexpr std::uint32_t kMaxRegions = 1024;
    explicit Regions(std::uint32_t capacity = kMaxRegions) : RegionTable{capacity} {}
  };

  /// `grid` must outlive the predictor.
  Predictor(const RegionGrid& grid, PredictionSettings settings) : grid_{&grid}, settings_{settings} {}

  /// Adds the position of the tip's centre at `time`; times must ascend. If more than 0.1 s have passed since the
  /// previous call, starts a new history. Times above 1e9 s are too inexact for a prediction.
  void observe(double time, const Vec3d& position, bool in_contact);

  /// Adds to `out` the regions that the tip will touch within `lead` seconds after the last observation.
  void predict(double lead, Regions& out) const;

  /// Motion at the last observation, fitted to the history.
  struct Motion {
    Vec3d position, velocity, acceleration;
  };
  [[nodiscard]] Motion motion() const noexcept;

 private:
  static constexpr std::uint32_t kHistory = 24;
  static constexpr double kSpacing = MotionSegment::kSpacing;  // s between samples; the history covers 48 ms
  struct Sample {
    double time;
    Vec3d position;
  };
  [[nodiscard]] const Sample& sample(std::uint32_t back) const noexcept {
    return history_[(newest_ + kHistory - back) % kHistory];
  }

  [[nodiscard]] bool add_path_regions(double lead, Regions& out) const;

  const RegionGrid* grid_;
  PredictionSettings settings_;
  MotionSegment motion_segment_;
  std::array<Sample, kHistory> history_;
  std::uint32_t newest_ = 0;
  std::uint32_t count_ = 0;
  Sample last_{0, Vec3d::Zero()};
  bool on_surface_ = false;
};

/// Predicts the regions of a probe of several spheres, with a Predictor for each sphere.
class ProbePredictor {
 public:
  /// `scale` is the number of units of `shape` per file unit. The radius of each sphere replaces `settings.radius`.
  ProbePredictor(const RegionGrid& grid, const ProbeShape& shape, double scale, PredictionSettings settings) {
    for (const ProbeSphere& sphere : shape.spheres()) {
      settings.radius = sphere.radius / scale;
      predictors_.emplace_back(grid, settings);
    }
  }

  /// `spheres` are the spheres of the shape at `time`, in the same order.
  void observe(double time, std::span<const PlacedSphere> spheres, bool in_contact) {
    for (std::size_t i = 0; i < predictors_.size(); ++i) predictors_[i].observe(time, spheres[i].centre, in_contact);
  }
  void predict(double lead, Predictor::Regions& out) const {
    for (const Predictor& predictor : predictors_) predictor.predict(lead, out);
  }

 private:
  std::vector<Predictor> predictors_;
};

}  // namespace tactus::spm
