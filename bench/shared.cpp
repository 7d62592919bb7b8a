// Compares four methods for one object that several users hold over a network. Virtual time.
//
// Each method is tuned in the same way: two parameters, 12 candidates, the same cost, on tuning seeds. The rows come
// from runs of other seeds with the tuned parameters.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "study/shared_world.hpp"

namespace tactus::bench {
namespace {

using namespace study;

struct Settings {
  int seeds = 3;
  bool quick = false;
};

constexpr double kSeconds = 12;  // of each run; the users move for 6 s
constexpr double kLoss = 0.2, kBurstEnd = 0.25;
constexpr std::uint64_t kTuningSeeds = 1'000'000;  // tuning uses the seeds above this one, rows those from 1
constexpr int kMaxSeeds = 1000;
static_assert(kMaxSeeds < kTuningSeeds);

// Requirements, chosen before the first run.
constexpr double kMaxSettlingTime = 2;  // s from the end of the hands' motion until the object rests
constexpr double kMaxDistance = 5;      // mm between copies at rest
constexpr double kMaxInjected = 1;      // mJ a minute that the network adds; a hand does not feel this energy

/// Returns a link that loses a share of `loss` of the samples, in bursts of 4 on average.
netem::LinkProfile bursty_link(double delay_ms, double jitter_ms, double loss) {
  netem::LinkProfile link{delay_ms, jitter_ms};
  link.burst_end = kBurstEnd;
  link.burst_start = loss > 0 ? kBurstEnd * loss / (1 - loss) : 0;
  return link;
}

template <class... Values>
std::string format_line(const char* format, Values... values) {
  char text[200];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

/// The worst results of several seeds.
struct WorstResult {
  double settled = 0;            // settling time, s
  double apart = 0, moving = 0;  // distance between copies at rest, and in motion, mm
  double injected = 0;           // mJ a minute
  double limited_share = 0;      // share of cycles in which a tank limited a set position
  double force = 0;              // peak, N
  double tank = 0;               // min energy of a tank, J
  bool finite = true;

  /// Returns the max of the results divided by their requirements. It is at most 1 if all requirements hold.
  [[nodiscard]] double cost() const {
    return finite ? std::max({settled / kMaxSettlingTime, apart / kMaxDistance, injected / kMaxInjected}) : HUGE_VAL;
  }
};

/// Runs the method with `seeds` seeds from `first_seed` on, until one diverges.
WorstResult worst_of(WorldSettings settings, std::uint64_t first_seed, int seeds) {
  WorstResult worst;
  for (int i = 0; i < seeds && worst.finite; ++i) {
    settings.seed = first_seed + static_cast<std::uint64_t>(i);
    const CarryResult result = carry(settings, kSeconds);
    worst.settled = std::max(worst.settled, result.settling_time);
    worst.apart = std::max(worst.apart, result.end_copy_distance * 1e3);
    worst.moving = std::max(worst.moving, result.max_copy_distance * 1e3);
    worst.injected = std::max(worst.injected, result.injected * 1e3 * 60 / kSeconds);
    worst.limited_share = std::max(worst.limited_share, result.limited_share);
    worst.force = std::max(worst.force, result.peak_force);
    worst.tank = std::min(worst.tank, result.tank_lowest);
    worst.finite = result.finite;
  }
  return worst;
}

constexpr std::array kMethods{Method::kChannel, Method::kSpring, Method::kNaive, Method::kServer};

/// Returns the 12 candidates of a method for a link of `delay_s` in each direction. They differ in stiffness and in a
/// second parameter, playout delay or damping.
std::vector<WorldSettings> candidates(WorldSettings world, double delay_s) {
  std::vector<WorldSettings> all;
  for (const double stiffness : {0.5, 1.0, 2.0, 10.0})
    for (const double second : {1.0, 3.0, 9.0}) {
      if (world.method == Method::kServer) {
        world.grip = 200 * stiffness;  // of each hand, since this method has no coupling between copies
        world.grip_damping = 4 * second / 3;
      } else {
        world.coupling = 1000 * stiffness;
        world.coupling_damping = second;
        world.playout = delay_s * (1 + 0.2 * second / 3);  // 7, 20 and 60 % above the delay
      }
      all.push_back(world);
    }
  return all;
}

/// Returns the candidate of least cost. Among candidates that meet the requirements, returns the one whose copies are
/// closest in motion.
WorldSettings tune(const WorldSettings& world, double delay_s, int seeds) {
  WorldSettings best = world;
  double min_cost = HUGE_VAL, min_moving = HUGE_VAL;
  for (const WorldSettings& candidate : candidates(world, delay_s)) {
    const WorstResult worst = worst_of(candidate, kTuningSeeds + 1, seeds);
    const double cost = std::max(1.0, worst.cost());
    if (cost > min_cost || (cost == min_cost && worst.moving >= min_moving)) continue;
    min_cost = cost;
    min_moving = worst.moving;
    best = candidate;
  }
  return best;
}

/// Returns the first columns of a row: method, users and tuned parameters.
std::string row_head(const WorldSettings& world) {
  const bool server = world.method == Method::kServer, channel = world.method == Method::kChannel;
  return format_line("  %-12s %5zu %6.0f %6.1f %s", kMethodNames[static_cast<int>(world.method)], world.users,
                     server ? world.grip : world.coupling,
                     server    ? world.grip_damping
                     : channel ? 1e3 * world.playout
                               : world.coupling_damping,
                     channel ? "ms   " : "N s/m");
}

Report run(const Settings& settings) {
  const std::vector<std::size_t> users =
      settings.quick ? std::vector<std::size_t>{2, 8} : std::vector<std::size_t>{2, 3, 4, 8};
  const int seeds = settings.seeds;
  Report report{{"a box of 0.5 kg, 12 x 12 x 8 cm, held at its sides", 0, 0,
                 format_line("1 kHz; tuned on %d seeds from %llu, rows of seeds 1 to %d; round trip 200 ms, "
                             "50 ms jitter (two standard deviations in each direction), 20 %% lost in bursts of 4",
                             seeds, static_cast<unsigned long long>(kTuningSeeds) + 1, seeds)}};

  report.set_virtual_time(true);
  WorstResult channel_worst;
  report.add_note("                      tuned          settling       distance, mm        added     tank    force");
  report.add_note("  method       users    N/m           time, s    at rest   moving   mJ a minute  limits  peak, N");
  for (const Method method : kMethods)
    for (const std::size_t count : users) {
      std::fprintf(stderr, "carry: %s, %zu users\n", kMethodNames[static_cast<int>(method)], count);
      constexpr double kDelay = 0.1;  // s
      WorldSettings world;
      world.method = method;
      world.users = count;
      world.link = bursty_link(1e3 * kDelay, 25, kLoss);
      world = tune(world, kDelay, seeds);
      const WorstResult worst = worst_of(world, 1, seeds);
      report.add_note(row_head(world) +
                      (worst.finite
                           ? format_line("  %6.2f %12.2f %8.1f %12.3g %6.1f %% %7.2f", worst.settled, worst.apart,
                                         worst.moving, worst.injected, worst.limited_share * 100, worst.force)
                           : std::string("     diverges")));
      if (method != Method::kChannel) continue;
      channel_worst.settled = std::max(channel_worst.settled, worst.settled);
      channel_worst.apart = std::max(channel_worst.apart, worst.apart);
      channel_worst.injected = std::max(channel_worst.injected, worst.injected);
      channel_worst.tank = std::min(channel_worst.tank, worst.tank);
      channel_worst.finite = channel_worst.finite && worst.finite;
    }

  double mass_error = 0;
  std::size_t mass_runs = 0;  // with wave-variable channels
  report.add_note("");
  report.add_note(
      "  apparent mass divided by mass, at a round trip of 50 ms; in brackets damping, N s/m; tuned for this link");
  report.add_note("  method       users    N/m            0.25 Hz          0.5 Hz         0.75 Hz            1 Hz");
  for (const Method method : kMethods)
    for (const std::size_t count : users) {
      if (method == Method::kServer && count != users.front())
        continue;  // the number of users has no effect on this method
      std::fprintf(stderr, "apparent mass: %s, %zu users\n", kMethodNames[static_cast<int>(method)], count);
      constexpr double kDelay = 0.025;  // s
      WorldSettings world;
      world.method = method;
      world.users = count;
      world.link = bursty_link(1e3 * kDelay, 0, 0);
      world = tune(world, kDelay, 1);  // without loss, seeds change only the hands
      std::string text = row_head(world);
      for (const double frequency : {0.25, 0.5, 0.75, 1.0}) {
        const MassResult result = apparent_mass(world, frequency);
        const double ratio = result.mass / world.mass;
        const bool is_finite = std::isfinite(ratio) && std::abs(ratio) > 1e-3;
        text += is_finite ? format_line(" %7.2f (%5.1f)", ratio, result.damping) : std::string("     diverges");
        if (method != Method::kChannel) continue;
        mass_error = std::max(mass_error, is_finite ? std::abs(ratio - 1) : HUGE_VAL);
        ++mass_runs;
      }
      report.add_note(text);
    }

  const Population population{"runs with wave-variable channels", users.size() * static_cast<std::size_t>(seeds)};
  report.add_at_most("max time from the end of the hands' motion until the object rests", population, "s",
                     channel_worst.settled, kMaxSettlingTime);
  report.add_at_most("max distance between copies 1 s after the end of the hands' motion", population, "mm",
                     channel_worst.apart, kMaxDistance);
  report.add_at_most("max energy added by the network", population, "mJ a minute", channel_worst.injected,
                     kMaxInjected);
  report.add_at_least("min energy of the tank of a copy", population, "J", channel_worst.tank, -1e-12);
  report.add_at_least("runs with finite results (1: all, 0: not all)", population, "", channel_worst.finite ? 1 : 0, 1);
  report.add_at_most("max relative error of the apparent mass up to 1 Hz, round trip 50 ms",
                     {"runs with wave-variable channels", mass_runs}, "", mass_error, 0.1);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"shared", "Compares four tuned methods for one object that several users hold over a network",
                         "2 and 8 users"};
  app.add_option("--seeds", settings.seeds, "number of seeds for tuning, and of seeds for the rows")
      ->check(CLI::Range(1, tactus::bench::kMaxSeeds));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    return tactus::bench::run(settings);
  });
}
