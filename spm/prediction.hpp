/// Predicts the regions that a probe will touch, and when, so that they can be loaded before.
///
/// Each strategy places spheres in space and time. The time to contact of a region is the earliest sphere that
/// intersects it. All strategies but the mixture are the paper's ideas. We differ: the history consists of tip
/// positions, because a region is too coarse to extrapolate from at 1 kHz. `scripts/bench prediction` shows how many
/// regions each strategy loads in time and in vain.
///
/// Model frame, file units, seconds. Fixed memory. One thread, not the haptic one: about 10 us; the mixture in contact
/// takes some 50 us, and a few hundred with a look-ahead of 0.15 s.
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
  kNeighbours,  ///< around the tip, as far as it can get at its speed
  kLinear,      ///< along its velocity
  kPolynomial,  ///< along its velocity and acceleration
  kDistance,    ///< around the tip, as far as it can get at half its speed
  kMixture      ///< in contact the predicted path (MotionSegment); otherwise linear and distance
};
/// By Strategy: the names for users.
inline constexpr std::array<const char*, 5> kStrategyNames{"neighbours", "linear", "polynomial", "distance", "mixture"};

struct PredictedRegion {
  RegionId region{};
  double contact_in = 0;     ///< s; 0: touched now
  double contact_until = 0;  ///< s; the end of the contact
  double doubt = 0;          ///< distance from the predicted path, in standard deviations of the prediction

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
  double margin = 0;     ///< file units; max distance of a region from the tip's path
  double min_speed = 0;  ///< file units/s; expected when a tip at rest starts
  Strategy strategy = Strategy::kMixture;
};

class Predictor {
 public:
  /// The soonest contact first, once sorted. If there are more regions than fit, the latest are dropped.
  struct Answer : RegionTable<PredictedRegion> {
    static constexpr std::uint32_t kMaxRegions = 1024;
    explicit Answer(std::uint32_t capacity = kMaxRegions) : RegionTable{capacity} {}
  };

  /// `grid` must outlive it.
  Predictor(const RegionGrid& grid, PredictionSettings settings) : grid_{&grid}, settings_{settings} {}

  /// Adds the position of the tip's centre at `time`; times ascend. A gap of more than 0.1 s starts a new history.
  void observe(double time, const Vec3d& position, bool in_contact);

  /// Adds the regions that the tip will touch within `lead` of the last observation.
  void predict(double lead, Answer& out) const;

  /// Motion fitted to the history: position, velocity, acceleration at the last observation.
  struct Motion {
    Vec3d position, velocity, acceleration;
  };
  [[nodiscard]] Motion motion() const noexcept;

 private:
  static constexpr std::uint32_t kHistory = 24;
  static constexpr double kSpacing = MotionSegment::kSpacing;  // between samples: 48 ms of history
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

/// The same for a probe of several spheres, each with its own path.
class ProbePredictor {
 public:
  /// `scale`: units of `shape` per file unit. The radius of each sphere replaces that of `settings`.
  ProbePredictor(const RegionGrid& grid, const ProbeShape& shape, double scale, PredictionSettings settings) {
    for (const ProbeSphere& sphere : shape.spheres()) {
      settings.radius = sphere.radius / scale;
      predictors_.emplace_back(grid, settings);
    }
  }

  /// `spheres`: the spheres of the shape at `time`, in the same order.
  void observe(double time, std::span<const PlacedSphere> spheres, bool in_contact) {
    for (std::size_t i = 0; i < predictors_.size(); ++i) predictors_[i].observe(time, spheres[i].centre, in_contact);
  }
  void predict(double lead, Predictor::Answer& out) const {
    for (const Predictor& predictor : predictors_) predictor.predict(lead, out);
  }

 private:
  std::vector<Predictor> predictors_;
};

}  // namespace tactus::spm
