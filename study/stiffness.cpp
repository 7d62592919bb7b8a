#include "study/stiffness.hpp"

#include <algorithm>
#include <cmath>
#include <deque>

#include "haptics/force.hpp"
#include "haptics/passivity.hpp"
#include "study/constants.hpp"
#include "study/shared_world.hpp"

namespace tactus::study {
namespace {

using haptics::Vec3d;

constexpr int kSubsteps = 10;

/// Returns whether a mass that 1 N presses against a wall comes to rest. `delay` is the delay of the wall's force, s.
bool rests_on_wall(double stiffness, double delay, bool has_passivity_controller) {
  const auto cycles = static_cast<std::size_t>(std::lround(delay / kCycle));
  std::deque<Vec3d> in_transit(cycles, Vec3d::Zero());
  haptics::PassivityController passivity_controller;
  double x = 0.001, v = 0, early = 0, late = 0;
  const int total = 20'000;
  for (int cycle = 0; cycle < total; ++cycle) {
    // The wall may pull, because the analytic bound is for a linear system.
    in_transit.push_back({-stiffness * x, 0, 0});
    Vec3d force = in_transit.front();
    in_transit.pop_front();
    if (has_passivity_controller) force = passivity_controller.step(force, {x, 0, 0}, 0, kCycle);
    for (int i = 0; i < kSubsteps; ++i) {
      const double h = kCycle / kSubsteps;
      v = (v + h / kDeviceMass * (force.x() + 1)) / (1 + h / kDeviceMass * kDeviceDamping);
      x += h * v;
    }
    if (!(std::abs(v) < 1e3)) return false;
    if (cycle > total / 4 && cycle <= total / 2) early = std::max(early, std::abs(v));
    if (cycle > 3 * total / 4) late = std::max(late, std::abs(v));
  }
  return late < 1e-4 || late < 0.9 * early;
}

/// Returns the largest stiffness from 5 N/m to kMaxStiffness for which `stable` returns true, or 0 if there is none.
/// Bisects the logarithm.
template <class Stable>
double largest(Stable&& stable, int steps) {
  if (stable(kMaxStiffness)) return kMaxStiffness;
  double low = std::log(5.0), high = std::log(kMaxStiffness);
  if (!stable(5)) return 0;
  for (int i = 0; i < steps; ++i) {
    const double middle = (low + high) / 2;
    (stable(std::exp(middle)) ? low : high) = middle;
  }
  return std::exp(low);
}

}  // namespace

Stiffness largest_stable_stiffness(double round_trip, int steps) {
  constexpr double kCopyDamping = 3;  // N s/m
  Stiffness found;
  found.wall_bound = haptics::stable_stiffness(kDeviceDamping, 0, kCycle, round_trip);
  found.wall = largest([&](double k) { return rests_on_wall(k, round_trip, false); }, steps);
  found.wall_passivity = largest([&](double k) { return rests_on_wall(k, round_trip, true); }, steps);
  found.copies_bound = 0.8 * 2 * kCopyDamping / (round_trip + kCycle);
  const auto copies = [&](Method method) {
    WorldSettings world;
    world.method = method;
    world.link = {round_trip / 2 * 1e3, 0};
    world.playout = round_trip / 2 + 0.001;
    return largest(
        [&](double k) {
          world.coupling = k;
          return comes_to_rest(world);
        },
        steps);
  };
  found.copies_naive = copies(Method::kNaive);
  found.copies_set = copies(Method::kSpring);
  found.copies_channel = copies(Method::kChannel);
  return found;
}

}  // namespace tactus::study
