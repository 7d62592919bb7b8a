// Probe states on a link that mesh records fill, beside the idle link, in alternating pairs.
#include <cstdio>

#include "bench/coded_rows.hpp"
#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"

namespace tactus::bench {
namespace {

constexpr char kOneQueue[] = "P0:rate=100";  // what waits for the rate goes in the order in which it came

/// Of each run of one kind.
struct Runs {
  Samples p50, p99, p999, max, mesh;
  double expected = 0, lost = 0;

  void add(const latency::Result& run) {
    p50.add(run.age.p50);
    p99.add(run.age.p99);
    p999.add(run.age.p999);
    max.add(run.age.max);
    mesh.add(run.load_mbyte_per_s);
    expected += static_cast<double>(run.expected);
    lost += static_cast<double>(run.lost);
  }
};

int run(const PairSettings& settings) {
  const std::atomic<bool>& stop = wire::stop_signal();
  const latency::RunSettings place = run_settings();
  const auto measure_on = [&](const std::string& link, latency::Profile profile, double load) {
    latency::Cell cell;
    cell.profile = profile;
    cell.load_mbit = load;
    cell.link = link;
    cell.seconds = settings.seconds;
    return latency::run_here(cell, place, stop);
  };
  const auto measure = [&](latency::Profile profile, double load) { return measure_on(settings.link, profile, load); };

  Runs idle, loaded, plain, shared, paced, slow, slow_paced;
  for (int pair = 0; pair < settings.pairs; ++pair) {
    std::fprintf(stderr, "pair %d of %d\n", pair + 1, settings.pairs);
    idle.add(measure(latency::Profile::kTactus, 0));
    loaded.add(measure(latency::Profile::kTactus, latency::kUnpaced));
    paced.add(measure_on(kOneQueue, latency::Profile::kTactus, latency::kUnpaced));  // from 1 to 5 ms, run by run
    if (pair % 5 != 0) continue;
    plain.add(measure(latency::Profile::kPlain, latency::kUnpaced));
    shared.add(measure(latency::Profile::kShared, latency::kUnpaced));
    for (const auto& [link, runs] : {std::pair{"veth:rate=10", &slow}, {"P0:rate=10", &slow_paced}})
      runs->add(measure_on(link, latency::Profile::kTactus, latency::kUnpaced));
  }

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d alternating pairs of %g s, SCHED_FIFO where allowed",
                settings.link.c_str(), settings.pairs, settings.seconds);
  Report report{{"isolation", "probe states at 1 kHz beside mesh records", 0, 0, text}};
  for (const auto& [name, runs] : {std::pair{"idle", &idle},
                                   {"loaded", &loaded},
                                   {"loaded, plain profiles", &plain},
                                   {"loaded, plain profiles, one participant", &shared},
                                   {"loaded, one queue for all", &paced},
                                   {"loaded, 10 Mbit/s", &slow},
                                   {"loaded, 10 Mbit/s, one queue for all", &slow_paced}}) {
    report.row(std::string{name} + ": age p50", "one way, runs", "us", runs->p50);
    report.row(std::string{name} + ": age p99", "one way, runs", "us", runs->p99);
    report.row(std::string{name} + ": age p99.9", "one way, runs", "us", runs->p999);
    report.row(std::string{name} + ": age max", "one way, runs", "us", runs->max);
    report.row(std::string{name} + ": mesh", "payload, runs", "MB/s", runs->mesh);
    report.figure(std::string{name} + ": delivered", "probe states", "%", 100 - 100 * runs->lost / runs->expected);
  }
  report.note("Rows are over runs; the bounds compare their medians.");
  report.at_least("delivered, loaded", "probe states", "%", 100 - 100 * loaded.lost / loaded.expected, 100);
  report.at_most("age p99, loaded over idle", "medians of runs", "",
                 loaded.p99.percentile(50) / idle.p99.percentile(50), 1.7);
  report.at_most("age p99.9, loaded over idle", "medians of runs", "",
                 loaded.p999.percentile(50) / idle.p999.percentile(50), 2.5);
  report.at_least("mesh, loaded", "median of runs", "MB/s", loaded.mesh.percentile(50), 11);
  constexpr double kMs = 1e-3, kMbyte = 1 / 8.0;  // in us, of a Mbit
  report.at_most("one queue for all: age p99", "median of runs", "ms", kMs * paced.p99.percentile(50), 3);
  report.at_least("one queue for all: mesh", "median of runs", "MB/s", paced.mesh.percentile(50), 0.7 * 100 * kMbyte);
  report.at_most("10 Mbit/s: age p99", "median of runs", "ms", kMs * slow.p99.percentile(50), 5);
  add_coded_isolation(report, 2, 4 * settings.seconds, 20);
  return report.finish(settings.json);
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::PairSettings settings;
  settings.link = "veth:rate=100";
  bool quick = false;
  CLI::App app{"Probe states on a 100 Mbit/s link that mesh records fill, beside the idle link; needs root"};
  add_pair_options(app, settings, "between the namespaces, as in `tactus-link list`");
  app.add_flag("--quick", quick, "2 pairs of 2 s, for CI");
  return tactus::bench::latency_main(app, "tactus-bench-isolation", argc, argv, [&] {
    if (quick) settings.pairs = 2, settings.seconds = 2;
    return tactus::bench::run(settings);
  });
}
