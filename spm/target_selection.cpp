#include "spm/target_selection.hpp"

#include <algorithm>

namespace tactus::spm {
namespace {

// The key of a target is its squared distance plus the constant of its group.
constexpr double kNow = 0, kSoon = 1e12, kRefined = 2e12;
constexpr double kNotWanted = -1;

}  // namespace

void TargetSelection::begin(const Forest& forest, const TargetMargins& margins) noexcept {
  forest_ = &forest;
  margins_ = margins;
  targets_.clear();
}

/// Adds the loaded regions within `radius` of `centre` with the key `key_of(region, squared distance)`, unless the key
/// is kNotWanted.
template <class KeyOf>
void TargetSelection::add_within(const Vec3d& centre, double radius, KeyOf key_of) noexcept {
  const bool all = forest_->grid().for_each_intersecting(centre, radius, [&](RegionId region, double squared) {
    if (!forest_->is_loaded(region)) return;
    const double key = key_of(region, squared);
    if (key != kNotWanted) targets_.add({region, key});
  });
  if (!all && centre.allFinite()) targets_.mark_incomplete();
}

void TargetSelection::add_soon(const Vec3d& centre, double radius) noexcept {
  add_within(centre, radius, [](RegionId, double squared) { return kSoon + squared; });
}

void TargetSelection::add_sphere(const PlacedSphere& sphere) noexcept {
  // A sphere around the middle of the displacement that contains the probe's sphere before and after it.
  const double half = sphere.displacement.norm() / 2, reach = sphere.radius + half;
  const Vec3d middle = sphere.centre + sphere.displacement / 2;
  const double soon = reach + margins_.refine;
  add_within(middle, reach + std::max(margins_.refine, margins_.retain), [&](RegionId region, double squared) {
    if (squared > soon * soon) return forest_->is_refined(region) ? kRefined + squared : kNotWanted;
    if (squared > reach * reach) return kSoon + squared;
    const double now = half > 0 ? forest_->grid().squared_distance(region, sphere.centre) : squared;
    return now <= sphere.radius * sphere.radius ? kNow + now : kSoon + squared;
  });
}

std::span<const RegionId> TargetSelection::finish() noexcept {
  targets_.sort();
  const std::span<const Target> targets = targets_.entries();
  std::transform(targets.begin(), targets.end(), order_.begin(), [](const Target& target) { return target.region; });
  return {order_.data(), targets.size()};
}

bool is_exact(const Forest& forest, std::span<const PlacedSphere> spheres) noexcept {
  return std::all_of(spheres.begin(), spheres.end(),
                     [&](const PlacedSphere& sphere) { return forest.is_exact(sphere.centre, sphere.radius); });
}

}  // namespace tactus::spm
