// Idle latency of probe states beside raw UDP and Cyclone DDS, in turn between two namespaces joined by a veth.
#include "bench/latency_bench.hpp"

namespace tactus::bench {
namespace {

Report run(const PairSettings& settings) {
  std::vector<Runs> kinds;
  const auto add = [&](const char* name, latency::Transport transport) {
    latency::Cell cell;
    cell.transport = transport;
    cell.link = settings.link;
    kinds.push_back({name, cell});
  };
  add("raw UDP", latency::Transport::kRawUdp);
  add("probe state", latency::Transport::kUdp);
  if (latency::has_cyclone()) add("Cyclone DDS", latency::Transport::kCyclone);
  run_in_turn(kinds, settings);
  const Runs &raw = kinds[0], &ours = kinds[1];

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d rounds in rotating order of %g s each; %s", settings.link.c_str(),
                settings.pairs, settings.seconds, ours.note.c_str());
  Report report{{"probe states of 236 bytes at 1 kHz", 0, 0, text}};
  for (const Runs& kind : kinds) {
    add_rows(report, kind.name, "half round trip, runs", kind.half_round_trip);
    add_rows(report, kind.name + " from send,", "half round trip, runs", kind.half_round_trip_sent);
    add_rows(report, kind.name + " age", "one way, runs", kind.age);
  }
  report.note(
      "The bounds compare medians of runs. Half round trips start when a ping is due. `from send` leaves out how");
  report.note("late the system woke the pinger, which is alike for all.");
  const auto compare = [&](const Runs& with, double p50, double p99) {
    const auto ratio = [&](const std::string& name, const Samples& own, const Samples& other, double limit) {
      report.at_most(name + " over " + with.name + "'s", {"medians of runs", own.size()}, "times",
                     own.percentile(0.5) / other.percentile(0.5), limit);
    };
    ratio("p50", ours.half_round_trip.p50, with.half_round_trip.p50, p50);
    ratio("p99", ours.half_round_trip.p99, with.half_round_trip.p99, p99);
    ratio("p50 from send", ours.half_round_trip_sent.p50, with.half_round_trip_sent.p50, p50);
    ratio("p99 from send", ours.half_round_trip_sent.p99, with.half_round_trip_sent.p99, p99);
  };
  compare(raw, 1.3, 2);
  if (latency::has_cyclone())
    compare(kinds[2], 1, 1);
  else
    report.note("Built without Cyclone DDS.");
  constexpr double kCycle = 1000;  // us; a later state misses the cycle for which it was made
  report.at_most("p99.9", {"half round trip, median of runs", ours.half_round_trip.p999.size()}, "us",
                 ours.half_round_trip.p999.percentile(0.5), kCycle);
  report.at_most("pings or echoes lost", {"pings of all runs", static_cast<std::size_t>(ours.expected)}, "",
                 ours.lost + ours.echoes_lost, 0);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::PairSettings settings;
  settings.link = "veth";
  tactus::bench::App app{"latency",
                         "Idle half round trip of a probe state at 1 kHz beside raw UDP's; needs root for namespaces",
                         "3 rounds of 2 s"};
  add_pair_options(app, settings, "between the namespaces, as in `tactus-link list`; none: loopback, without root");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.pairs = 3, settings.seconds = 2;
    return tactus::bench::run(settings);
  });
}
