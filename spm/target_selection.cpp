#include "spm/target_selection.hpp"

#include <algorithm>

namespace tactus::spm {
namespace {

// Added to the squared distance, these order targets by how urgent they are.
constexpr double kNow = 0, kSoon = 1e12, kLeft = 2e12;
constexpr double kNotWanted = -1;

}  // namespace

void TargetSelection::begin(const Forest& forest, const TargetMargins& margins) noexcept {
  forest_ = &forest;
  margins_ = margins;
  targets_.clear();
}

/// Adds the regions that are here and no further than `radius` from `centre` by `key_of(region, squared distance)`,
/// unless that is kNotWanted.
template <class KeyOf>
void TargetSelection::look(const Vec3d& centre, double radius, KeyOf key_of) noexcept {
  const bool all = forest_->grid().for_each_meeting(centre, radius, [&](RegionId region, double squared) {
    if (!forest_->is_here(region)) return;
    const double key = key_of(region, squared);
    if (key != kNotWanted) targets_.add({region, key});
  });
  if (!all && centre.allFinite()) targets_.miss();
}

void TargetSelection::add_soon(const Vec3d& centre, double radius) noexcept {
  look(centre, radius, [](RegionId, double squared) { return kSoon + squared; });
}

void TargetSelection::add_sphere(const PlacedSphere& sphere) noexcept {
  const double half = sphere.ahead.norm() / 2;
  look(sphere.centre, sphere.radius, [](RegionId, double squared) { return kNow + squared; });
  add_soon(sphere.centre + sphere.ahead / 2, sphere.radius + half + margins_.refine);
  look(sphere.centre, sphere.radius + half + margins_.keep,
       [this](RegionId region, double squared) { return forest_->is_refined(region) ? kLeft + squared : kNotWanted; });
}

void TargetSelection::add_spheres(std::span<const PlacedSphere> spheres) noexcept {
  for (const PlacedSphere& sphere : spheres) {
    const double reach = sphere.radius + sphere.ahead.norm() / 2, soon = reach + margins_.refine;
    look(sphere.centre + sphere.ahead / 2, reach + std::max(margins_.refine, margins_.keep),
         [&](RegionId region, double squared) {
           if (squared > soon * soon) return forest_->is_refined(region) ? kLeft + squared : kNotWanted;
           const double now = forest_->grid().squared_distance(region, sphere.centre);
           return now <= sphere.radius * sphere.radius ? kNow + now : kSoon + squared;
         });
  }
}

std::span<const RegionId> TargetSelection::finish() noexcept {
  targets_.sort();
  const std::span<const Target> targets = targets_.entries();
  std::transform(targets.begin(), targets.end(), order_.begin(), [](const Target& target) { return target.region; });
  return {order_.data(), targets.size()};
}

bool exact(const Forest& forest, std::span<const PlacedSphere> spheres) noexcept {
  return std::all_of(spheres.begin(), spheres.end(),
                     [&](const PlacedSphere& sphere) { return forest.exact(sphere.centre, sphere.radius); });
}

}  // namespace tactus::spm
