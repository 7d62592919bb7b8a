// Measures the latency of probe states on an idle link between two network namespaces, compared with raw UDP and with
// Cyclone DDS.
#include "bench/latency_bench.hpp"

namespace tactus::bench {
namespace {

Report run(const RoundSettings& settings) {
  std::vector<Configuration> configurations;
  const auto add = [&](const char* name, latency::Transport transport) {
    latency::TestCase test;
    test.transport = transport;
    test.link = settings.link;
    configurations.push_back({name, test});
  };
  add("raw UDP", latency::Transport::kRawUdp);
  add("Tactus", latency::Transport::kUdp);
  if (latency::has_cyclone()) add("Cyclone DDS", latency::Transport::kCyclone);
  run_rounds(configurations, settings);
  const Configuration &raw = configurations[0], &ours = configurations[1];

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d rounds, each with another order of transports, %g s for each run; %s",
                settings.link.c_str(), settings.rounds, settings.seconds, ours.note.c_str());
  Report report{{"probe states of 236 bytes at 1 kHz", 0, 0, text}};
  for (const Configuration& configuration : configurations) {
    add_rows(report, configuration.name + ", half round trip", configuration.half_round_trip);
    add_rows(report, configuration.name + ", half round trip from send", configuration.half_round_trip_sent);
    add_rows(report, configuration.name + ", age (one way)", configuration.age);
  }
  report.add_note(
      "Bounds are on medians over the runs, on ratios of two such medians, and on the sum of lost pings and echoes.");
  report.add_note(
      "A half round trip counts from the time at which a ping is due, `from send` from the time at which the ping is");
  report.add_note(
      "sent. The latter excludes the delay of a late wake-up, and the time for which the previous ping blocked.");
  const auto compare = [&](const Configuration& reference, double p50_limit, double p99_limit) {
    const auto ratio = [&](const std::string& name, const Samples& own, const Samples& other, double limit) {
      report.add_at_most("half round trip " + name + ", Tactus divided by " + reference.name, {"runs", own.size()},
                         "times", own.percentile(0.5) / other.percentile(0.5), limit);
    };
    ratio("p50", ours.half_round_trip.p50, reference.half_round_trip.p50, p50_limit);
    ratio("p99", ours.half_round_trip.p99, reference.half_round_trip.p99, p99_limit);
    ratio("p50 from send", ours.half_round_trip_sent.p50, reference.half_round_trip_sent.p50, p50_limit);
    ratio("p99 from send", ours.half_round_trip_sent.p99, reference.half_round_trip_sent.p99, p99_limit);
  };
  compare(raw, 1.3, 2);
  if (latency::has_cyclone())
    compare(configurations[2], 1, 1);
  else
    report.add_note("Built without Cyclone DDS.");
  constexpr double kCycle = 1000;  // us; a state with a higher latency misses its cycle
  report.add_at_most("half round trip p99.9, Tactus", {"runs", ours.half_round_trip.p999.size()}, "us",
                     ours.half_round_trip.p999.percentile(0.5), kCycle);
  report.add_at_most("pings and echoes lost, Tactus", {"pings", static_cast<std::size_t>(ours.expected)}, "",
                     ours.lost + ours.echoes_lost, 0);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::RoundSettings settings;
  settings.link = "veth";
  tactus::bench::App app{
      "latency", "Half round trip of probe states at 1 kHz on an idle link, compared with raw UDP and Cyclone DDS",
      "3 rounds with runs of 2 s"};
  add_round_options(app, settings,
                    "link between the namespaces, as in `tactus-link list`; none: loopback, without root");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.rounds = 3, settings.seconds = 2;
    return tactus::bench::run(settings);
  });
}
