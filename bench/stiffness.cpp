// The largest stiffness that stays stable, against the round trip, for each way to render contact; in virtual time.
#include "study/stiffness.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"

namespace tactus::bench {
namespace {

using namespace study;

struct Settings {
  bool quick = false;
};

std::string cell(double value) {
  char text[32];
  if (value >= kMaxStiffness) {
    std::snprintf(text, sizeof text, " > %7.0f", kMaxStiffness);
  } else {
    std::snprintf(text, sizeof text, " %9.0f", value);
  }
  return text;
}

Report run(const Settings& settings) {
  char text[160];
  std::snprintf(
      text, sizeof text,
      "device and hand %.1f kg, %.0f N s/m; two copies of a box of 0.5 kg, 3 N s/m each; searched to %.0f N/m",
      kDeviceMass, kDeviceDamping, kMaxStiffness);
  Report report{{"largest that stays stable", 0, 0, text}};
  report.virtual_time(true);
  report.note("  there   wall over the network, N/m          spring between two copies, N/m");
  report.note("  & back,   (b + B) /  hold      passivity     0.8 x 2 B /  hold      set        line");
  report.note("  ms      (T/2 + td)   last      passivity   (RTT + T)   last   position");
  const std::vector<double> trips =
      settings.quick ? std::vector<double>{0, 50, 200} : std::vector<double>{0, 5, 10, 20, 50, 100, 200, 300};
  const int steps = settings.quick ? 6 : 9;
  double conservative = 1e9, min_line = kMaxStiffness;
  for (const double trip_ms : trips) {
    const Stiffness found = largest_stable_stiffness(trip_ms * 1e-3, steps);
    char row[32];
    std::snprintf(row, sizeof row, "  %5.0f ", trip_ms);
    report.note(row + cell(found.wall_bound) + cell(found.wall) + cell(found.wall_passivity) + "   " +
                cell(found.copies_bound) + cell(found.copies_naive) + cell(found.copies_set) +
                cell(found.copies_channel));
    conservative = std::min(conservative, found.wall / found.wall_bound);
    min_line = std::min(min_line, found.copies_channel);
  }
  report.at_least("what a wall's hold-last stands over its bound", "all round trips, least", "", conservative, 1);
  report.at_least("coupling of two copies on the line", "all round trips, least", "N/m", min_line, 2000);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "stiffness", "The largest stable stiffness against the round trip, for each method beside its analytic bound.",
      "three round trips"};
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    return tactus::bench::run(settings);
  });
}
