// Measures the age of probe states on a link that mesh records fill, compared with the idle link, and with Fast DDS and
// Cyclone DDS that are tuned for the link.
#include "bench/coded_rows.hpp"
#include "bench/latency_bench.hpp"

namespace tactus::bench {
namespace {

using latency::Profile;
using latency::Transport;

constexpr char kOneQueue[] = "P0:rate=100";  // link emulation with one queue for all traffic classes

// Bounds. A state that is older than one cycle misses its cycle. The p99 of the age may be a tenth of a cycle higher
// than on the idle link, and a tenth of a cycle higher than with a system tuned by hand.
constexpr double kCycle = 1000, kTenthOfCycle = 100;  // us
constexpr double kMinMeshShare = 0.9;                 // of the mesh throughput of a system tuned by hand
constexpr double kMbytePerMbit = 1 / 8.0;

Report run(const RoundSettings& settings) {
  std::vector<Configuration> configurations;
  const auto add = [&](const char* name, const std::string& link, double load_mbit, int round_interval = 1,
                       Profile profile = Profile::kTactus, Transport transport = Transport::kUdp) {
    latency::TestCase cell;
    cell.transport = transport;
    cell.profile = profile;
    cell.load_mbit = load_mbit;
    cell.link = link;
    configurations.push_back({name, cell, round_interval});
    return configurations.size() - 1;
  };
  constexpr double kMax = latency::kUnpaced;
  constexpr int kSeldom = 5;  // one of five rounds
  const std::size_t idle = add("Tactus, idle", settings.link, 0), loaded = add("Tactus", settings.link, kMax);
  const std::size_t one_queue = add("Tactus, one queue", kOneQueue, kMax);
  std::vector<std::size_t> peers{add("tuned Fast DDS, rate set by hand", settings.link, kMax, 1, Profile::kTuned)};
  add("tuned Fast DDS, rate set by hand, one queue", kOneQueue, kMax, kSeldom, Profile::kTuned);
  if (latency::has_cyclone()) {
    peers.push_back(
        add("tuned Cyclone DDS with socket marks", settings.link, kMax, 1, Profile::kTactus, Transport::kCyclone));
    add("tuned Cyclone DDS, unpaced, one queue", kOneQueue, kMax, kSeldom, Profile::kTactus, Transport::kCyclone);
  }
  add("Fast DDS, defaults", settings.link, kMax, kSeldom, Profile::kPlain);
  add("Fast DDS, defaults, one participant", settings.link, kMax, kSeldom, Profile::kShared);
  const std::size_t slow = add("Tactus, 10 Mbit/s", "veth:rate=10", kMax, kSeldom);
  add("Tactus, 10 Mbit/s, one queue", "P0:rate=10", kMax, kSeldom);
  run_rounds(configurations, settings);

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d rounds, each with another order of transports, %g s for each run; %s",
                settings.link.c_str(), settings.rounds, settings.seconds, configurations[loaded].note.c_str());
  Report report{{"probe states at 1 kHz, with mesh records on the same link", 0, 0, text}};
  for (const Configuration& configuration : configurations) {
    add_rows(report, configuration.name + ", age", configuration.age);
    report.add_percentiles(configuration.name + ", mesh payload rate", "runs", "MB/s", configuration.mesh_mbyte_per_s);
    report.add_value(configuration.name + ", delivered",
                     {"probe states", static_cast<std::size_t>(configuration.expected)}, "%",
                     configuration.delivered_percent());
  }
  report.add_note(
      "Each bound on age or mesh payload is on the median over the runs. Tactus does not know the rate of the link.");
  const auto median = [](const Samples& runs) { return runs.percentile(0.5); };
  const Configuration& ours = configurations[loaded];
  report.add_at_least("Tactus, delivered", {"probe states", static_cast<std::size_t>(ours.expected)}, "%",
                      ours.delivered_percent(), 100);
  report.add_at_most("Tactus, age p99.9", {"runs", ours.mesh_mbyte_per_s.size()}, "us", median(ours.age.p999), kCycle);
  report.add_at_most("age p99, Tactus loaded minus idle", {"runs", ours.mesh_mbyte_per_s.size()}, "us",
                     median(ours.age.p99) - median(configurations[idle].age.p99), kTenthOfCycle);
  for (const std::size_t peer : peers) {
    const Configuration& theirs = configurations[peer];
    report.add_at_most("age p99, Tactus minus " + theirs.name, {"runs", ours.mesh_mbyte_per_s.size()}, "us",
                       median(ours.age.p99) - median(theirs.age.p99), kTenthOfCycle);
    report.add_at_least("mesh payload rate, Tactus divided by " + theirs.name, {"runs", ours.mesh_mbyte_per_s.size()},
                        "times", median(ours.mesh_mbyte_per_s) / median(theirs.mesh_mbyte_per_s), kMinMeshShare);
  }
  report.add_at_most("Tactus, one queue, age p99", {"runs", configurations[one_queue].mesh_mbyte_per_s.size()}, "us",
                     median(configurations[one_queue].age.p99), 3 * kCycle);
  report.add_at_least("Tactus, one queue, mesh payload rate",
                      {"runs", configurations[one_queue].mesh_mbyte_per_s.size()}, "MB/s",
                      median(configurations[one_queue].mesh_mbyte_per_s), 0.7 * 100 * kMbytePerMbit);
  report.add_at_most("Tactus, 10 Mbit/s, age p99", {"runs", configurations[slow].mesh_mbyte_per_s.size()}, "us",
                     median(configurations[slow].age.p99), 5 * kCycle);
  add_coded_isolation(report, 2, 4 * settings.seconds, 20);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::RoundSettings settings;
  settings.link = "veth:rate=100";
  tactus::bench::App app{
      "isolation",
      "Age of probe states on a 100 Mbit/s link that mesh records fill, compared with other systems; needs root",
      "2 rounds with runs of 2 s"};
  add_round_options(app, settings, "link between the namespaces, as in `tactus-link list`");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.rounds = 2, settings.seconds = 2;
    return tactus::bench::run(settings);
  });
}
