// Measures the energy that the port of a hand gives at 2,000 N/m, at a wall and on a shared object, for round trips of
// 0 to 500 ms with loss. Virtual time.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "haptics/passivity.hpp"
#include "haptics/simulated_device.hpp"
#include "study/shared_world.hpp"

namespace tactus::bench {
namespace {

using namespace haptics;
using namespace study;

struct Settings {
  double stiffness = 2000;
  double damping = 6;
  int seconds = 60;
  bool quick = false;
};

constexpr double kPeriod = 1e-3;          // s
constexpr double kMinPortEnergy = -1e-6;  // J

struct PortResult {
  double min_energy = 0;   // J
  double withholding = 0;  // cycles in which force was withheld, divided by cycles
};

/// Simulates a trembling hand that taps a fixed wall, with a device of little damping. If `control` is true, the
/// passivity controller withholds force.
PortResult tap_wall(double stiffness, double speed, int seconds, bool control, unsigned seed) {
  DeviceSpec spec;
  spec.damping = 0.2;
  HandSettings hand;
  hand.start = {0, 0, 0.02};
  hand.tremor = 3e-4;
  hand.encoder_step = 1e-5;
  hand.seed = seed;
  SimulatedDevice device{hand, spec};
  PassivityController passivity;
  PortResult port;
  Vec3d force = Vec3d::Zero(), last_position = hand.start;
  double energy = 0;
  for (int cycle = 0; cycle < seconds * 1000; ++cycle) {
    HandPath path;
    path.count = 1;
    const double phase = std::fmod(cycle * kPeriod * speed / 0.06, 1.0);
    path.waypoints[0] = {0, {0, 0, 0.02 - 0.06 * (phase < 0.5 ? phase : 1 - phase)}};
    device.paths().post(path);
    const DeviceState state = device.read(cycle * 1'000'000LL);
    energy -= force.dot(state.position - last_position);  // independent of the passivity controller's own count
    last_position = state.position;
    port.min_energy = std::min(port.min_energy, energy);
    const Vec3d wall{0, 0, stiffness * std::max(0.0, -state.position.z())};
    force = passivity.step(wall, state.position, 0, kPeriod, control);
    device.write(force);
  }
  port.withholding = static_cast<double>(passivity.ledger().withholding) / (1000.0 * seconds);
  return port;
}

template <class... Values>
std::string format_line(const char* format, Values... values) {
  char text[200];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

Report run(const Settings& settings) {
  char text[120];
  std::snprintf(text, sizeof text, "%.0f N/m, 1 kHz; encoder steps of 10 um at the wall; 10 %% lost in bursts of 4",
                settings.stiffness);
  Report report{{"a wall; a box of 0.5 kg held by several users", 0, 0, text}};
  report.set_virtual_time(true);
  double min_wall = 0, min_shared = 0, min_tank = 0;
  std::size_t wall_runs = 0, shared_runs = 0;
  bool all_finite = true;
  const int seconds = settings.quick ? 5 : settings.seconds;
  report.add_note("                                          min energy, J          cycles in which");
  report.add_note("                                     without        with      force was withheld");
  for (const double speed : {0.02, 0.1, 0.3, 0.6}) {
    const PortResult without = tap_wall(settings.stiffness, speed, seconds, false, 1);
    const PortResult with = tap_wall(settings.stiffness, speed, seconds, true, 1);
    min_wall = std::min(min_wall, with.min_energy);
    ++wall_runs;
    report.add_note(format_line("  wall, hand at %.2f m/s       %12.2e %12.2e %14.2f %%", speed, without.min_energy,
                                with.min_energy, with.withholding * 100));
  }
  for (const double round_trip : {0.0, 20.0, 50.0, 100.0, 200.0, 500.0}) {
    for (const std::size_t users : {std::size_t{2}, std::size_t{4}}) {
      if (settings.quick && users != 2) continue;
      WorldSettings world;
      world.users = users;
      world.grip = settings.stiffness;
      world.grip_damping = settings.damping;
      world.link = {round_trip / 2, round_trip / 20};
      world.link.burst_end = 0.25;
      world.link.burst_start = 0.25 * 0.1 / 0.9;
      world.playout = round_trip / 2000 * 1.25 + 0.002;
      world.port_control = false;
      const CarryResult without = carry(world, 12);
      world.port_control = true;
      const CarryResult with = carry(world, 12);
      min_shared = std::min(min_shared, with.port_lowest);
      min_tank = std::min(min_tank, with.tank_lowest);
      ++shared_runs;
      all_finite = all_finite && with.finite;
      report.add_note(format_line("  object, %zu users, %3.0f ms      %12.2e %12.2e %14.2f %%", users, round_trip,
                                  without.port_lowest, with.port_lowest, with.withholding * 100));
    }
  }
  report.add_at_least("min energy of the port of a hand at a wall", {"runs", wall_runs}, "J", min_wall, kMinPortEnergy);
  report.add_at_least("min energy of the port of a hand on a shared object, 0 to 500 ms", {"runs", shared_runs}, "J",
                      min_shared, kMinPortEnergy);
  report.add_at_least("min energy of the tank of a copy, 0 to 500 ms", {"runs", shared_runs}, "J", min_tank, -1e-12);
  // A run that diverges ends early, and its energies are those until then.
  report.add_at_least("runs with finite results (1: all, 0: not all)", {"runs", shared_runs}, "", all_finite ? 1 : 0,
                      1);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "passive", "Measures the energy that the ports of hands give, at round trips of 0 to 500 ms with 10 % loss",
      "5 s at each speed, 2 users"};
  app.add_option("--stiffness", settings.stiffness, "stiffness of wall and coupling, N/m")
      ->check(tactus::wire::finite_range(100.0, 5000.0));
  app.add_option("--damping", settings.damping, "damping between a hand and the object that it holds, N s/m")
      ->check(tactus::wire::finite_range(0.0, 20.0));
  app.add_option("--seconds", settings.seconds, "time of tapping at each speed, s")->check(CLI::Range(1, 3600));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    return tactus::bench::run(settings);
  });
}
