// Measures the max stable stiffness of each method of contact rendering, by round trip. Virtual time.
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

/// Returns a stiffness as a table cell, N/m.
std::string table_cell(double value) {
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
  Report report{{"none: a wall, and two copies of a box", 0, 0, text}};
  report.set_virtual_time(true);
  report.add_note("  round   wall over the network, N/m          spring between two copies, N/m");
  report.add_note("  trip,     (b + B) /  hold      passivity     0.8 x 2 B /  hold      set        wave");
  report.add_note("  ms      (T/2 + td)   last      control     (RTT + T)   last   position  variables");
  const std::vector<double> round_trips_ms =
      settings.quick ? std::vector<double>{0, 50, 200} : std::vector<double>{0, 5, 10, 20, 50, 100, 200, 300};
  const int steps = settings.quick ? 6 : 9;
  double min_ratio = 1e9, min_channel = kMaxStiffness;
  for (const double round_trip_ms : round_trips_ms) {
    const Stiffness stiffness = largest_stable_stiffness(round_trip_ms * 1e-3, steps);
    char row[32];
    std::snprintf(row, sizeof row, "  %5.0f ", round_trip_ms);
    report.add_note(row + table_cell(stiffness.wall_bound) + table_cell(stiffness.wall) +
                    table_cell(stiffness.wall_passivity) + "   " + table_cell(stiffness.copies_bound) +
                    table_cell(stiffness.copies_naive) + table_cell(stiffness.copies_set) +
                    table_cell(stiffness.copies_channel));
    min_ratio = std::min(min_ratio, stiffness.wall / stiffness.wall_bound);
    min_channel = std::min(min_channel, stiffness.copies_channel);
  }
  const Population round_trips{"round trips", round_trips_ms.size()};
  report.add_at_least("min of stable stiffness of a wall with hold-last divided by its analytic bound", round_trips,
                      "times", min_ratio, 1);
  report.add_at_least("min of stable stiffness of two copies with a wave-variable channel", round_trips, "N/m",
                      min_channel, 2000);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "stiffness",
      "Measures the max stable stiffness of each method by round trip, and compares it with the analytic bound",
      "three round trips"};
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    return tactus::bench::run(settings);
  });
}
