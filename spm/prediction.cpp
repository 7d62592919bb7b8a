#include "spm/prediction.hpp"

#include <algorithm>

namespace tactus::spm {
namespace {

/// Keeps the earliest and the latest time of each region.
void meet(Predictor::Answer& out, RegionId region, double time) noexcept {
  for (std::uint32_t i = 0; i < out.count; ++i)
    if (out.regions[i].region == region) {
      out.regions[i].contact_in = std::min(out.regions[i].contact_in, time);
      out.regions[i].contact_until = std::max(out.regions[i].contact_until, time);
      return;
    }
  if (out.count == Predictor::kMaxRegions) {
    out.complete = false;
    return;
  }
  out.regions[out.count++] = {region, time, time};
}

}  // namespace

void Predictor::observe(double time, const Vec3d& position, bool in_contact) noexcept {
  constexpr double kGap = 0.1;
  if (count_ > 0 && time - last_.time > kGap) count_ = 0;
  last_ = {time, position};
  in_contact_ = in_contact;
  if (count_ > 0 && time - history_[newest_].time < kSpacing) return;
  newest_ = (newest_ + 1) % kHistory;
  history_[newest_] = last_;
  count_ = std::min(count_ + 1, kHistory);
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

void Predictor::predict(const RegionGrid& grid, double radius, double lead, Answer& out) const noexcept {
  out.count = 0;
  out.complete = true;
  const Motion now = motion();
  const double speed = std::max(now.velocity.norm(), settings_.least_speed);
  const double reach = radius + settings_.margin;
  const auto add_ball = [&](const Vec3d& centre, double ball, double contact_in) {
    if (!grid.for_each_meeting(centre, ball, [&](RegionId region, double) { meet(out, region, contact_in); }))
      out.complete = false;
  };
  const Strategy strategy = settings_.strategy;
  const bool mixture = strategy == Strategy::kMixture;

  add_ball(now.position, reach, 0);
  constexpr int kSteps = 6;
  for (int step = 1; step <= kSteps; ++step) {
    const double t = lead * step / kSteps;
    const Vec3d linear = now.position + now.velocity * t;
    if (mixture || strategy == Strategy::kLinear) add_ball(linear, reach, t);
    if ((mixture && in_contact_) || strategy == Strategy::kPolynomial) {
      // A fitted acceleration holds for about as long as the history it was fitted to.
      const double trusted = std::min(t, 0.05);
      add_ball(linear + now.acceleration * (trusted * trusted / 2), reach, t);
    }
    if ((mixture && !in_contact_) || strategy == Strategy::kDistance)
      add_ball(now.position, reach + speed * t / 2, t);  // it may turn
    if (strategy == Strategy::kNeighbours) add_ball(now.position, reach + speed * t, t);
  }
  if (mixture && in_contact_) add_ball(now.position, reach + speed * lead / 4, lead);  // local neighbours: it may turn

  std::sort(out.regions.begin(), out.regions.begin() + out.count,
            [](const PredictedRegion& a, const PredictedRegion& b) {
              return a.contact_in != b.contact_in ? a.contact_in < b.contact_in : index(a.region) < index(b.region);
            });
}

}  // namespace tactus::spm
