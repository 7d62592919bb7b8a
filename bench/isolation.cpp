// Probe states on a link that mesh records fill, beside the idle link and beside Fast DDS and Cyclone DDS as their
// experts tune them for it, in turn.
#include "bench/coded_rows.hpp"
#include "bench/latency_bench.hpp"

namespace tactus::bench {
namespace {

using latency::Profile;
using latency::Transport;

constexpr char kOneQueue[] = "P0:rate=100";  // a relay with one queue, in the order of arrival

// What a user needs, before any run. A state that comes a whole cycle late misses the cycle for which it was made. A
// tenth of a cycle is what we may cost more than a system tuned by hand, or than the idle link.
constexpr double kCycle = 1000, kTenth = 100;  // us
constexpr double kMeshShare = 0.9;             // of the mesh that a system tuned by hand transfers
constexpr double kMbyte = 1 / 8.0;             // of a Mbit

Report run(const PairSettings& settings) {
  std::vector<Runs> kinds;
  const auto add = [&](const char* name, const std::string& link, double load, int every = 1,
                       Profile profile = Profile::kTactus, Transport transport = Transport::kUdp) {
    latency::Cell cell;
    cell.transport = transport;
    cell.profile = profile;
    cell.load_mbit = load;
    cell.link = link;
    kinds.push_back({name, cell, every});
    return kinds.size() - 1;
  };
  constexpr double kMax = latency::kUnpaced;
  constexpr int kSeldom = 5;
  const std::size_t idle = add("idle", settings.link, 0), loaded = add("loaded", settings.link, kMax);
  const std::size_t one_queue = add("loaded, one queue", kOneQueue, kMax);
  std::vector<std::size_t> peers{add("tuned Fast DDS, its rate set by hand", settings.link, kMax, 1, Profile::kTuned)};
  add("tuned Fast DDS, its rate set by hand, one queue", kOneQueue, kMax, kSeldom, Profile::kTuned);
  if (latency::has_cyclone()) {
    peers.push_back(add("tuned Cyclone DDS, sockets marked from outside", settings.link, kMax, 1, Profile::kTactus,
                        Transport::kCyclone));
    add("tuned Cyclone DDS, one queue: it cannot pace", kOneQueue, kMax, kSeldom, Profile::kTactus,
        Transport::kCyclone);
  }
  add("Fast DDS, defaults", settings.link, kMax, kSeldom, Profile::kPlain);
  add("Fast DDS, defaults, one participant", settings.link, kMax, kSeldom, Profile::kShared);
  const std::size_t slow = add("loaded, 10 Mbit/s", "veth:rate=10", kMax, kSeldom);
  add("loaded, 10 Mbit/s, one queue", "P0:rate=10", kMax, kSeldom);
  run_in_turn(kinds, settings);

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d rounds in rotating order of %g s each; %s", settings.link.c_str(),
                settings.pairs, settings.seconds, kinds[loaded].note.c_str());
  Report report{{"probe states at 1 kHz beside mesh records", 0, 0, text}};
  for (const Runs& kind : kinds) {
    add_rows(report, kind.name + ": age", "one way, runs", kind.age);
    report.row(kind.name + ": mesh", "payload, runs", "MB/s", kind.mesh);
    report.figure(kind.name + ": delivered", {"probe states", static_cast<std::size_t>(kind.expected)}, "%",
                  kind.delivered_percent());
  }
  report.note("The bounds compare medians of runs. Tactus is not configured with the rate of the link.");
  const auto median = [](const Samples& runs) { return runs.percentile(0.5); };
  const Runs& ours = kinds[loaded];
  report.at_least("loaded: delivered", {"probe states", static_cast<std::size_t>(ours.expected)}, "%",
                  ours.delivered_percent(), 100);
  report.at_most("loaded: age p99.9", {"median of runs", ours.mesh.size()}, "us", median(ours.age.p999), kCycle);
  report.at_most("age p99, loaded less idle", {"medians of runs", ours.mesh.size()}, "us",
                 median(ours.age.p99) - median(kinds[idle].age.p99), kTenth);
  for (const std::size_t peer : peers) {
    const Runs& theirs = kinds[peer];
    report.at_most("age p99, ours less that of " + theirs.name, {"medians of runs", ours.mesh.size()}, "us",
                   median(ours.age.p99) - median(theirs.age.p99), kTenth);
    report.at_least("mesh, ours over that of " + theirs.name, {"medians of runs", ours.mesh.size()}, "times",
                    median(ours.mesh) / median(theirs.mesh), kMeshShare);
  }
  report.at_most("one queue: age p99", {"median of runs", kinds[one_queue].mesh.size()}, "us",
                 median(kinds[one_queue].age.p99), 3 * kCycle);
  report.at_least("one queue: mesh", {"median of runs", kinds[one_queue].mesh.size()}, "MB/s",
                  median(kinds[one_queue].mesh), 0.7 * 100 * kMbyte);
  report.at_most("10 Mbit/s: age p99", {"median of runs", kinds[slow].mesh.size()}, "us", median(kinds[slow].age.p99),
                 5 * kCycle);
  add_coded_isolation(report, 2, 4 * settings.seconds, 20);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::PairSettings settings;
  settings.link = "veth:rate=100";
  tactus::bench::App app{
      "isolation",
      "Probe states on a 100 Mbit/s link that mesh records fill, beside the idle link and peers; needs root",
      "2 rounds of 2 s"};
  add_pair_options(app, settings, "between the namespaces, as in `tactus-link list`");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.pairs = 2, settings.seconds = 2;
    return tactus::bench::run(settings);
  });
}
