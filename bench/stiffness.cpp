// The largest stiffness that stays stable, against the round trip, for each way to render contact; in virtual time.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/shared_world.hpp"
#include "haptics/force.hpp"
#include "haptics/passivity.hpp"

namespace tactus::bench {
namespace {

using namespace haptics;

struct Settings {
  std::string json;
  bool quick = false;
};

constexpr double kDt = 1e-3;
constexpr double kMost = 20'000;  // N/m, of the search
constexpr double kMass = 0.2;     // kg, of device and hand
constexpr double kDamping = 5;    // N s/m, of both
constexpr int kSubsteps = 10;

/// A mass pressed into a wall by 1 N, whose force comes `delay` later; whether it comes to rest.
bool rests_on_wall(double stiffness, double delay, bool control) {
  const auto cycles = static_cast<std::size_t>(std::lround(delay / kDt));
  std::deque<Vec3d> under_way(cycles, Vec3d::Zero());
  PassivityController controller;
  double x = 0.001, v = 0, early = 0, late = 0;
  const int total = 20'000;
  for (int cycle = 0; cycle < total; ++cycle) {
    // Nothing hinders the wall from pulling: its linear limit is what the bound is about.
    under_way.push_back({-stiffness * x, 0, 0});
    Vec3d force = under_way.front();
    under_way.pop_front();
    if (control) force = controller.step(force, {x, 0, 0}, 0, kDt);
    for (int i = 0; i < kSubsteps; ++i) {
      const double h = kDt / kSubsteps;
      v = (v + h / kMass * (force.x() + 1)) / (1 + h / kMass * kDamping);
      x += h * v;
    }
    if (!(std::abs(v) < 1e3)) return false;
    if (cycle > total / 4 && cycle <= total / 2) early = std::max(early, std::abs(v));
    if (cycle > 3 * total / 4) late = std::max(late, std::abs(v));
  }
  return late < 1e-4 || late < 0.9 * early;
}

/// The largest stiffness up to kMost at which `stable` holds, by bisection of its logarithm; 0: none from 5 N/m on.
template <class Stable>
double largest(Stable&& stable, int steps) {
  if (stable(kMost)) return kMost;
  double low = std::log(5.0), high = std::log(kMost);
  if (!stable(5)) return 0;
  for (int i = 0; i < steps; ++i) {
    const double middle = (low + high) / 2;
    (stable(std::exp(middle)) ? low : high) = middle;
  }
  return std::exp(low);
}

std::string cell(double value) {
  char text[32];
  if (value >= kMost) {
    std::snprintf(text, sizeof text, " > %7.0f", kMost);
  } else {
    std::snprintf(text, sizeof text, " %9.0f", value);
  }
  return text;
}

int run(const Settings& settings) {
  char text[160];
  std::snprintf(
      text, sizeof text,
      "device and hand %.1f kg, %.0f N s/m; two copies of a box of 0.5 kg, 3 N s/m each; searched to %.0f N/m", kMass,
      kDamping, kMost);
  Report report{{"stiffness", "largest that stays stable", 0, 0, text}};
  report.note("  there   wall over the network, N/m          spring between two copies, N/m");
  report.note("  & back,   (b + B) /  hold      passivity     0.8 x 2 B /  hold      set        line");
  report.note("  ms      (T/2 + td)   last      controller  (RTT + T)   last   position");
  const std::vector<double> trips =
      settings.quick ? std::vector<double>{0, 50, 200} : std::vector<double>{0, 5, 10, 20, 50, 100, 200, 300};
  const int steps = settings.quick ? 6 : 9;
  double conservative = 1e9, least_line = kMost;
  for (const double trip_ms : trips) {
    const double trip = trip_ms * 1e-3;
    const double bound = stable_stiffness(kDamping, 0, kDt, trip);
    const double wall = largest([&](double k) { return rests_on_wall(k, trip, false); }, steps);
    const double held = largest([&](double k) { return rests_on_wall(k, trip, true); }, steps);
    WorldSettings world;
    world.link = {trip_ms / 2, 0};
    world.playout = trip / 2 + 0.001;
    const auto copies = [&](Method method) {
      return largest(
          [&](double k) {
            world.method = method;
            world.coupling = k;
            return settles(world);
          },
          steps);
    };
    const double peer_bound = 0.8 * 2 * 3 / (trip + kDt);
    const double naive = copies(Method::kNaive), modulated = copies(Method::kSpring), line = copies(Method::kLine);
    char row[32];
    std::snprintf(row, sizeof row, "  %5.0f ", trip_ms);
    report.note(row + cell(bound) + cell(wall) + cell(held) + "   " + cell(peer_bound) + cell(naive) + cell(modulated) +
                cell(line));
    conservative = std::min(conservative, wall / bound);
    least_line = std::min(least_line, line);
  }
  report.at_least("what a wall's hold-last stands over its bound", "all round trips, least", "", conservative, 1);
  report.at_least("coupling of two copies on the line", "all round trips, least", "N/m", least_line, 2000);
  return report.finish(settings.json);
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  CLI::App app{"The largest stable stiffness against the round trip, for each method beside its analytic bound."};
  app.add_flag("--quick", settings.quick, "three round trips");
  app.add_option("--json", settings.json, "the figures as JSON");
  return tactus::bench::bench_main(app, "tactus-bench-stiffness", argc, argv,
                                   [&] { return tactus::bench::run(settings); });
}
