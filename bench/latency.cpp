// Idle latency of probe states beside raw UDP and Cyclone DDS, in turn between two namespaces joined by a veth.
#include <cstdio>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"

namespace tactus::bench {
namespace {

/// Of each run of one transport.
struct Runs {
  Samples p50, p99, p999, max, sent_p50, sent_p99, age_p50, age_p99;
  double lost = 0;

  void add(const latency::Result& run) {
    p50.add(run.half_round_trip.p50);
    p99.add(run.half_round_trip.p99);
    p999.add(run.half_round_trip.p999);
    max.add(run.half_round_trip.max);
    sent_p50.add(run.half_round_trip_sent.p50);
    sent_p99.add(run.half_round_trip_sent.p99);
    age_p50.add(run.age.p50);
    age_p99.add(run.age.p99);
    lost += static_cast<double>(run.lost + run.echoes_lost);
  }
};

int run(const PairSettings& settings) {
  const std::atomic<bool>& stop = wire::stop_signal();
  const latency::RunSettings place = run_settings();
  latency::Cell raw, ours;
  raw.transport = latency::Transport::kRawUdp;
  raw.link = ours.link = settings.link;
  raw.seconds = ours.seconds = settings.seconds;

  Runs of_raw, of_ours, of_cyclone;
  latency::Cell cyclone = ours;
  cyclone.transport = latency::Transport::kCyclone;
  std::string realtime;
  for (int pair = 0; pair < settings.pairs; ++pair) {
    std::fprintf(stderr, "pair %d of %d\n", pair + 1, settings.pairs);
    of_raw.add(latency::run_here(raw, place, stop));
    if (latency::has_cyclone()) of_cyclone.add(latency::run_here(cyclone, place, stop));
    const latency::Result result = latency::run_here(ours, place, stop);
    of_ours.add(result);
    realtime = result.notes.front();
  }

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d alternating pairs of %g s; %s", settings.link.c_str(), settings.pairs,
                settings.seconds, realtime.c_str());
  Report report{{"latency", "probe states of 232 bytes at 1 kHz", 0, 0, text}};
  const auto rows = [&](const char* who, const Runs& runs) {
    const std::string name = who;
    report.row(name + " p50", "half round trip, runs", "us", runs.p50);
    report.row(name + " p99", "half round trip, runs", "us", runs.p99);
    report.row(name + " p99.9", "half round trip, runs", "us", runs.p999);
    report.row(name + " max", "half round trip, runs", "us", runs.max);
    report.row(name + " from send, p50", "half round trip, runs", "us", runs.sent_p50);
    report.row(name + " from send, p99", "half round trip, runs", "us", runs.sent_p99);
    report.row(name + " age p50", "one way, runs", "us", runs.age_p50);
    report.row(name + " age p99", "one way, runs", "us", runs.age_p99);
  };
  rows("raw UDP", of_raw);
  rows("probe state", of_ours);
  if (latency::has_cyclone()) rows("Cyclone DDS", of_cyclone);
  report.note(
      "Rows are over runs: their p50 is the median that the bounds compare. Half round trips count from when a");
  report.note(
      "ping was to be sent; `from send` leaves out how late the system woke the pinger, which both have alike.");
  const auto ratio = [](const Samples& a, const Samples& b) { return a.percentile(50) / b.percentile(50); };
  report.at_most("p50 over raw UDP's", "medians of runs", "", ratio(of_ours.p50, of_raw.p50), 1.3);
  report.at_most("p99 over raw UDP's", "medians of runs", "", ratio(of_ours.p99, of_raw.p99), 2);
  report.at_most("p50 from send over raw UDP's", "medians of runs", "", ratio(of_ours.sent_p50, of_raw.sent_p50), 1.3);
  report.at_most("p99 from send over raw UDP's", "medians of runs", "", ratio(of_ours.sent_p99, of_raw.sent_p99), 2);
  if (latency::has_cyclone()) {
    report.at_most("p50 over Cyclone DDS's", "medians of runs", "", ratio(of_ours.p50, of_cyclone.p50), 1);
    report.at_most("p99 over Cyclone DDS's", "medians of runs", "", ratio(of_ours.p99, of_cyclone.p99), 1);
    report.at_most("p50 from send over Cyclone DDS's", "medians of runs", "",
                   ratio(of_ours.sent_p50, of_cyclone.sent_p50), 1);
    report.at_most("p99 from send over Cyclone DDS's", "medians of runs", "",
                   ratio(of_ours.sent_p99, of_cyclone.sent_p99), 1);
  } else {
    report.note("Without Cyclone DDS, which was not there to build with.");
  }
  report.at_most("pings or echoes lost", "all runs", "", of_ours.lost, 0);
  return report.finish(settings.json);
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::PairSettings settings;
  settings.link = "veth";
  bool quick = false;
  CLI::App app{"Idle half round trip of a probe state at 1 kHz beside raw UDP's; needs root for namespaces"};
  add_pair_options(app, settings, "between the namespaces, as in `tactus-link list`; none: loopback, without root");
  app.add_flag("--quick", quick, "3 pairs of 2 s, for CI");
  return tactus::bench::latency_main(app, "tactus-bench-latency", argc, argv, [&] {
    if (quick) settings.pairs = 3, settings.seconds = 2;
    return tactus::bench::run(settings);
  });
}
