// One object that several users hold over a network, in virtual time: copies on a passive line beside the other ways.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "study/shared_world.hpp"

namespace tactus::bench {
namespace {

using namespace study;

struct Settings {
  std::string json;
  int seeds = 3;
  bool quick = false;
};

constexpr double kSeconds = 12;  // of each run, 6 of which the users move
constexpr double kLoss = 0.2, kBurstEnd = 0.25;

netem::LinkProfile bursty(double delay_ms, double jitter_ms, double loss) {
  netem::LinkProfile link{delay_ms, jitter_ms};
  link.burst_end = kBurstEnd;
  link.burst_start = loss > 0 ? kBurstEnd * loss / (1 - loss) : 0;
  return link;
}

template <class... Values>
std::string line(const char* format, Values... values) {
  char text[200];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

/// Of all seeds the worst.
struct Worst {
  double settled = 0, apart = 0, moving = 0, injected = 0, held = 0, force = 0, tank = 0;
  bool finite = true;
};

Worst worst_of(WorldSettings settings, int seeds) {
  Worst worst;
  for (int seed = 1; seed <= seeds; ++seed) {
    settings.seed = static_cast<std::uint64_t>(seed);
    const CarryResult result = carry(settings, kSeconds);
    worst.settled = std::max(worst.settled, result.settled);
    worst.apart = std::max(worst.apart, result.apart * 1e3);
    worst.moving = std::max(worst.moving, result.apart_moving * 1e3);
    worst.injected = std::max(worst.injected, result.injected * 1e3 * 60 / kSeconds);
    worst.held = std::max(worst.held, result.held);
    worst.force = std::max(worst.force, result.peak_force);
    worst.tank = std::min(worst.tank, result.tank_lowest);
    worst.finite = worst.finite && result.finite;
  }
  return worst;
}

int run(const Settings& settings) {
  const std::vector<std::size_t> users =
      settings.quick ? std::vector<std::size_t>{2, 8} : std::vector<std::size_t>{2, 3, 4, 8};
  const std::vector<double> couplings =
      settings.quick ? std::vector<double>{2000, 10000} : std::vector<double>{500, 1000, 2000, 10000};
  const int seeds = settings.quick ? 1 : settings.seeds;
  Report report{{"shared", "a box of 0.5 kg, 12 x 12 x 8 cm, held at its sides", 0, 0,
                 line("%d seeds, 1 kHz; 200 ms there and back, 50 ms jitter (two standard deviations, each way), 20 %% "
                      "lost in bursts of 4",
                      seeds)}};

  Worst of_line;
  report.note("                              settled      copies apart, mm    injected   tank    force");
  report.note("  method       users  N/m     after, s   1 s after  moving   mJ a minute  short   peak, N");
  for (const Method method : {Method::kChannel, Method::kSpring, Method::kNaive, Method::kServer}) {
    for (const std::size_t count : users) {
      for (const double coupling : couplings) {
        if (method == Method::kServer && coupling != couplings.front()) continue;  // it has none
        WorldSettings world;
        world.method = method;
        world.users = count;
        world.coupling = coupling;
        world.link = bursty(100, 25, kLoss);
        world.playout = 0.16;
        const Worst worst = worst_of(world, seeds);
        const std::string which = line("  %-12s %5zu %5.0f", kMethodNames[static_cast<int>(method)], count, coupling);
        report.note(which + (worst.finite
                                 ? line("     %6.2f %12.2f %8.1f %12.3g %6.1f %% %7.2f", worst.settled, worst.apart,
                                        worst.moving, worst.injected, worst.held * 100, worst.force)
                                 : std::string("     without end")));
        if (method != Method::kChannel) continue;
        of_line.settled = std::max(of_line.settled, worst.settled);
        of_line.apart = std::max(of_line.apart, worst.apart);
        of_line.injected = std::max(of_line.injected, worst.injected);
        of_line.tank = std::min(of_line.tank, worst.tank);
        of_line.finite = of_line.finite && worst.finite;
      }
    }
  }

  double furthest = 0;
  report.note("");
  report.note("  apparent mass / mass at 50 ms there and back; in brackets N s/m");
  report.note("  method       users  N/m         0.25 Hz          0.5 Hz         0.75 Hz            1 Hz");
  for (const Method method : {Method::kChannel, Method::kSpring, Method::kNaive, Method::kServer}) {
    for (const std::size_t count : users) {
      for (const double coupling : couplings) {
        if (method == Method::kServer && (coupling != couplings.front() || count != users.front())) continue;
        WorldSettings world;
        world.method = method;
        world.users = count;
        world.coupling = coupling;
        world.link = bursty(25, 0, 0);
        world.playout = 0.026;
        std::string text = line("  %-12s %5zu %5.0f", kMethodNames[static_cast<int>(method)], count, coupling);
        for (const double frequency : {0.25, 0.5, 0.75, 1.0}) {
          const MassResult result = apparent_mass(world, frequency);
          const double ratio = result.mass / world.mass;
          const bool known = std::isfinite(ratio) && std::abs(ratio) > 1e-3;
          text += known ? line(" %7.2f (%5.1f)", ratio, result.damping) : std::string("     without end");
          if (method == Method::kChannel) furthest = std::max(furthest, known ? std::abs(ratio - 1) : 1e9);
        }
        report.note(text);
      }
    }
  }

  report.note("");
  for (const std::size_t count : {std::size_t{2}, std::size_t{8}}) {
    WorldSettings world;
    world.users = count;
    world.link = bursty(100, 25, kLoss);
    world.playout = 0.16;
    const MassResult result = apparent_mass(world, 0.5);
    report.note(line("  line, %zu users, at 200 ms with jitter and loss: %.1f times the mass at 0.5 Hz, %.1f N s/m",
                     count, result.mass / world.mass, result.damping));
  }

  report.at_most("settled after the users' rest", "line, worst run", "s", of_line.settled, 2);
  report.at_most("copies apart 1 s after the rest", "line, worst run", "mm", of_line.apart, 5);
  report.at_most("injected energy", "line, worst run", "mJ a minute", of_line.injected, 1);
  report.at_least("energy of a copy's tank", "line, lowest", "J", of_line.tank, -1e-12);
  report.at_most("apparent mass off by", "line, up to 1 Hz, 50 ms", "", furthest, 0.1);
  report.at_least("runs that stayed finite", "line", "", of_line.finite ? 1 : 0, 1);
  return report.finish(settings.json);
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  CLI::App app{"One object held by several users over a network: the ways to simulate it, in virtual time."};
  app.add_option("--seeds", settings.seeds, "runs of each cell")->check(CLI::Range(1, 1000));
  app.add_flag("--quick", settings.quick, "fewer cells, one seed");
  app.add_option("--json", settings.json, "the figures as JSON");
  return tactus::bench::bench_main(app, "tactus-bench-shared", argc, argv,
                                   [&] { return tactus::bench::run(settings); });
}
