/// Which regions a probe will meet, and when: what to load before it is touched.
///
/// Each strategy puts balls in time and space; a region's time to contact is the earliest ball that meets it. All but
/// the mixture are the paper's ideas. We differ: the history is of tip positions, which know their regions, for a
/// region is too coarse to extrapolate from at 1 kHz. What each fetches in time and in vain: scripts/bench prediction.
///
/// Model frame, file units, seconds. Fixed memory. One thread; not the haptic one (about 10 us; the mixture in contact
/// some 50, and a few hundred when it looks 0.15 s ahead).
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (prediction of contact regions).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "spm/motion_segment.hpp"
#include "spm/probe_spheres.hpp"
#include "spm/region_grid.hpp"
#include "spm/region_table.hpp"

namespace tactus::spm {

enum class Strategy : std::uint8_t {
  kNeighbours,  ///< all around the tip, as far as it goes at its speed
  kLinear,      ///< along its velocity
  kPolynomial,  ///< along its velocity and acceleration
  kDistance,    ///< all around the tip, as far as half its speed takes it
  kMixture      ///< the way that a hand's strokes foretell, in contact; linear and distance without
};
/// By Strategy: what users call them.
inline constexpr std::array<const char*, 5> kStrategyNames{"neighbours", "linear", "polynomial", "distance", "mixture"};

struct PredictedRegion {
  RegionId region{};
  double contact_in = 0;     ///< s; 0: met now
  double contact_until = 0;  ///< s; the last time that it is met
  double doubt = 0;          ///< how far beside the expected way, in the distances that ways are missed by

  [[nodiscard]] bool before(const PredictedRegion& other) const noexcept {
    return contact_in != other.contact_in ? contact_in < other.contact_in : index(region) < index(other.region);
  }
  void merge(const PredictedRegion& other) noexcept {
    contact_in = std::min(contact_in, other.contact_in);
    contact_until = std::max(contact_until, other.contact_until);
    doubt = std::min(doubt, other.doubt);
  }
};

struct PredictionSettings {
  double radius = 0;     ///< file units, of the tip
  double margin = 0;     ///< file units; how far from the tip's path a region still counts as met
  double min_speed = 0;  ///< file units/s; a tip at rest is expected to start with this
  Strategy strategy = Strategy::kMixture;
};

class Predictor {
 public:
  /// Soonest first once sorted; what would be met last is dropped when there are more.
  struct Answer : RegionTable<PredictedRegion> {
    static constexpr std::uint32_t kMaxRegions = 1024;
    explicit Answer(std::uint32_t capacity = kMaxRegions) : RegionTable{capacity} {}
  };

  /// `grid` must outlive it.
  Predictor(const RegionGrid& grid, PredictionSettings settings) : grid_{&grid}, settings_{settings} {}

  /// The tip's centre at `time`; times ascend. A gap of more than 0.1 s starts a new history.
  void observe(double time, const Vec3d& position, bool in_contact);

  /// Adds the regions that the tip will meet within `lead` from the last observation.
  void predict(double lead, Answer& out) const;

  /// Motion fitted to the history: position, velocity, acceleration at the last observation.
  struct Motion {
    Vec3d position, velocity, acceleration;
  };
  [[nodiscard]] Motion motion() const noexcept;

 private:
  static constexpr std::uint32_t kHistory = 24;
  static constexpr double kSpacing = MotionSegment::kSpacing;  // between kept samples: 48 ms of history
  struct Sample {
    double time;
    Vec3d position;
  };
  [[nodiscard]] const Sample& sample(std::uint32_t back) const noexcept {
    return history_[(newest_ + kHistory - back) % kHistory];
  }

  [[nodiscard]] bool follow(double lead, Answer& out) const;

  const RegionGrid* grid_;
  PredictionSettings settings_;
  MotionSegment motion_segment_;
  std::array<Sample, kHistory> history_;
  std::uint32_t newest_ = 0;
  std::uint32_t count_ = 0;
  Sample last_{0, Vec3d::Zero()};
  bool on_surface_ = false;
};

/// The same for a probe of several spheres, each of which goes its own way.
class ProbePredictor {
 public:
  /// `shape`: in units of which `scale` make a file unit. `settings`: their radius is that of each sphere.
  ProbePredictor(const RegionGrid& grid, const ProbeShape& shape, double scale, PredictionSettings settings) {
    for (const ProbeSphere& sphere : shape.spheres()) {
      settings.radius = sphere.radius / scale;
      predictors_.emplace_back(grid, settings);
    }
  }

  /// `spheres`: those of the shape, in the same order, at `time`.
  void observe(double time, Span<const PlacedSphere> spheres, bool in_contact) {
    for (std::size_t i = 0; i < predictors_.size(); ++i) predictors_[i].observe(time, spheres[i].centre, in_contact);
  }
  void predict(double lead, Predictor::Answer& out) const {
    for (const Predictor& predictor : predictors_) predictor.predict(lead, out);
  }

 private:
  std::vector<Predictor> predictors_;
};

}  // namespace tactus::spm
