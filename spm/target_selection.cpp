#include "spm/target_selection.hpp"

#include <algorithm>

namespace tactus::spm {

void TargetSelection::begin(const Forest& forest, const TargetMargins& margins) noexcept {
  forest_ = &forest;
  margins_ = margins;
  targets_.clear();
}

/// Adds the loaded regions within `radius` of `centre`, unless their group is kNotWanted. `classify(target)` receives the
/// region and its squared distance from `centre`, and sets the group.
template <class Classify>
void TargetSelection::add_within(const Vec3d& centre, double radius, Classify classify) noexcept {
  const bool all = forest_->grid().for_each_intersecting(centre, radius, [&](RegionId region, double squared) {
    if (!forest_->is_loaded(region)) return;
    Target target{region, Group::kNotWanted, squared};
    classify(target);
    if (target.group != Group::kNotWanted) targets_.add(target);
  });
  if (!all && centre.allFinite()) targets_.mark_incomplete();
}

void TargetSelection::add_soon(const Vec3d& centre, double radius) noexcept {
  add_within(centre, radius, [](Target& target) { target.group = Group::kSoon; });
}

void TargetSelection::add_sphere(const PlacedSphere& sphere) noexcept {
  // A sphere around the middle of the displacement that contains the probe's sphere before and after it.
  const double half = sphere.displacement.norm() / 2, reach = sphere.radius + half;
  const Vec3d middle = sphere.centre + sphere.displacement / 2;
  const double soon = reach + margins_.refine;
  add_within(middle, reach + std::max(margins_.refine, margins_.retain), [&](Target& target) {
    if (target.squared_distance > soon * soon) {
      if (forest_->is_refined(target.region)) target.group = Group::kRefined;
      return;
    }
    target.group = Group::kSoon;
    if (target.squared_distance > reach * reach) return;
    const double now =
        half > 0 ? forest_->grid().squared_distance(target.region, sphere.centre) : target.squared_distance;
    if (now > sphere.radius * sphere.radius) return;
    target.group = Group::kNow;
    target.squared_distance = now;
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
