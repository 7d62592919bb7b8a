// Probe states on a link that mesh records fill, beside the idle link, in alternating pairs.
#include <cstdio>

#include "bench/coded_rows.hpp"
#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"

namespace tactus::bench {
namespace {

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
  const auto measure = [&](latency::Profile profile, double load) {
    latency::Cell cell;
    cell.profile = profile;
    cell.load_mbit = load;
    cell.link = settings.link;
    cell.seconds = settings.seconds;
    return latency::run_here(cell, place, stop);
  };

  Runs idle, loaded, plain;
  for (int pair = 0; pair < settings.pairs; ++pair) {
    std::fprintf(stderr, "pair %d of %d\n", pair + 1, settings.pairs);
    idle.add(measure(latency::Profile::kTactus, 0));
    loaded.add(measure(latency::Profile::kTactus, latency::kUnpaced));
    if (pair % 5 == 0) plain.add(measure(latency::Profile::kPlain, latency::kUnpaced));
  }

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d alternating pairs of %g s, SCHED_FIFO where allowed",
                settings.link.c_str(), settings.pairs, settings.seconds);
  Report report{{"isolation", "probe states at 1 kHz beside mesh records", 0, 0, text}};
  for (const auto& [name, runs] : {std::pair{"idle", &idle}, {"loaded", &loaded}, {"loaded, plain profiles", &plain}}) {
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
