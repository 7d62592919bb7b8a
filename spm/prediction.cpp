#include "spm/prediction.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::spm {
namespace {

constexpr double kPlane = 5;  // the tangent plane is fitted to the cells within this distance, in tip radii

}  // namespace

void Predictor::observe(double time, const Vec3d& position, bool in_contact) {
  constexpr double kGap = 0.1;
  if (count_ > 0 && time - last_.time > kGap) {
    count_ = 0;
    motion_segment_.restart();
  }
  const Sample before = count_ > 0 ? last_ : Sample{time, position};
  last_ = {time, position};
  // Where the mesh is coarse, the tip may touch the finest surface without a contact.
  on_surface_ = in_contact;
  if (!on_surface_ && settings_.strategy == Strategy::kMixture)
    grid_->for_each_intersecting(position, settings_.radius, [&](RegionId, double) { on_surface_ = true; });
  if (!on_surface_) motion_segment_.restart();
  // Resamples the positions at even intervals, by linear interpolation.
  constexpr double kTolerance = 1e-9;
  constexpr int kMaxSamples =
      static_cast<int>(kGap / kSpacing) + 2;  // ends the loop if a time is too large to increase
  double next = count_ > 0 ? history_[newest_].time + kSpacing : time;
  for (int i = 0; i < kMaxSamples && next <= time + kTolerance; ++i, next += kSpacing) {
    const double share = time > before.time ? std::min(1.0, (next - before.time) / (time - before.time)) : 1;
    newest_ = (newest_ + 1) % kHistory;
    history_[newest_] = {next, before.position + share * (position - before.position)};
    count_ = std::min(count_ + 1, kHistory);
    if (on_surface_ && settings_.strategy == Strategy::kMixture)
      motion_segment_.observe(*grid_, kPlane * settings_.radius, history_[newest_].position);
  }
}

Predictor::Motion Predictor::motion() const noexcept {
  Motion motion{last_.position, Vec3d::Zero(), Vec3d::Zero()};
  if (count_ < 2) return motion;
  // Least squares of a parabola through the last position: x(s) - x0 = v s + a s^2 / 2, s <= 0.
  double s2 = 0, s3 = 0, s4 = 0;
  Vec3d first = Vec3d::Zero(), second = Vec3d::Zero();
  for (std::uint32_t back = 0; back < count_; ++back) {
    const double s = sample(back).time - last_.time;
    const Vec3d moved = sample(back).position - last_.position;
    s2 += s * s;
    s3 += s * s * s;
    s4 += s * s * s * s;
    first += moved * s;
    second += moved * s * s;
  }
  if (s2 <= 0) return motion;
  const double determinant = s2 * s4 - s3 * s3;
  if (count_ < 6 || determinant <= 1e-9 * s2 * s4) {
    motion.velocity = first / s2;
    return motion;
  }
  motion.velocity = (first * s4 - second * s3) / determinant;
  motion.acceleration = 2 * (second * s2 - first * s3) / determinant;
  return motion;
}

/// Adds the regions along the predicted path, within its uncertainty. False if there is no prediction.
bool Predictor::add_path_regions(double lead, Regions& out) const {
  constexpr double kMaxSigmas = 2, kMaxRadii = 3;  // max distance from the path, in rms errors and in tip radii
  const MotionSegment::Path path = motion_segment_.predict(*grid_, kPlane * settings_.radius, lead);
  if (path.count == 0) return false;
  const double reach = settings_.radius + settings_.margin;
  for (std::uint32_t i = 0; i < path.count; ++i) {
    const double time = i * MotionSegment::kStep;
    const double sigma = std::max(motion_segment_.rms_error(time), 1e-3 * settings_.radius);
    const double max_distance = std::min(kMaxSigmas * sigma, kMaxRadii * settings_.radius);
    const auto visit = [&](RegionId region, double squared) {
      const double contact = std::min(time, lead);
      out.add({region, contact, contact, std::max(0.0, std::sqrt(squared) - reach) / sigma});
    };
    if (!grid_->for_each_intersecting(path.points[i], reach + max_distance, visit)) out.mark_incomplete();
    if (i + 1 < path.count)
      if (!grid_->for_each_intersecting((path.points[i] + path.points[i + 1]) / 2, reach + max_distance, visit))
        out.mark_incomplete();
  }
  // A slow tip may start in any direction.
  const double start_distance = settings_.min_speed * lead;
  if (motion().velocity.norm() < 2 * settings_.min_speed)
    grid_->for_each_intersecting(last_.position, reach + start_distance, [&](RegionId region, double) {
      out.add({region, lead, lead, kMaxSigmas});
    });
  return true;
}

void Predictor::predict(double lead, Regions& out) const {
  const Motion now = motion();
  const double speed = std::max(now.velocity.norm(), settings_.min_speed);
  const double reach = settings_.radius + settings_.margin;
  const auto add_sphere = [&](const Vec3d& centre, double sphere, double contact_in) {
    if (!grid_->for_each_intersecting(centre, sphere, [&](RegionId region, double) {
          out.add({region, contact_in, contact_in, 0});
        }))
      out.mark_incomplete();
  };
  const Strategy strategy = settings_.strategy;
  const bool mixture = strategy == Strategy::kMixture;

  add_sphere(now.position, reach, 0);
  // For later times the predicted path is better than extrapolation.
  constexpr double kNear = 0.025;  // s
  const double near = mixture && on_surface_ && add_path_regions(lead, out) ? std::min(lead, kNear) : lead;
  constexpr int kSteps = 6;
  for (int step = 1; step <= kSteps; ++step) {
    const double t = near * step / kSteps;
    const Vec3d linear = now.position + now.velocity * t;
    if (mixture || strategy == Strategy::kLinear) add_sphere(linear, reach, t);
    if ((mixture && on_surface_) || strategy == Strategy::kPolynomial) {
      // A fitted acceleration is valid for about the length of the history.
      const double trusted = std::min(t, 0.05);
      add_sphere(linear + now.acceleration * (trusted * trusted / 2), reach, t);
    }
    if ((mixture && !on_surface_) || strategy == Strategy::kDistance)
      add_sphere(now.position, reach + speed * t / 2, t);  // the tip may change direction
    if (strategy == Strategy::kNeighbours) add_sphere(now.position, reach + speed * t, t);
  }
  // The tip may change direction.
  if (mixture && on_surface_) add_sphere(now.position, reach + speed * near / 4, near);
}

}  // namespace tactus::spm
