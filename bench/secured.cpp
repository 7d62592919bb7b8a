// Measures what keys cost: age of probe states and mesh payload rate with keys, beside the same session without keys.
#include "bench/latency_bench.hpp"
#include "keys/authority.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

// Bounds of the cost of keys.
constexpr double kMoreAtP50 = 25, kMoreAtP99 = 50;  // us
constexpr double kMinMeshRate = 10.5;               // MB/s, on a link of 100 Mbit/s
constexpr double kLoadedMinusIdle = 100;            // us at p99, a tenth of a cycle

std::filesystem::path make_keys(const std::filesystem::path& folder) {
  const keys::Authority authority = keys::Authority::create(folder / "bench-keys");
  keys::NewMember member;
  member.name = "bench";
  member.role = keys::Role::kTester;
  return authority.add(member);
}

Report run(const RoundSettings& settings) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path keys = make_keys(folder.path());
  std::vector<Configuration> configurations;
  const auto add = [&](const char* name, double load_mbit, const std::filesystem::path& folder_of_keys) {
    latency::TestCase test;
    test.link = settings.link;
    test.load_mbit = load_mbit;
    configurations.push_back({name, test, 1, folder_of_keys});
    return configurations.size() - 1;
  };
  const std::size_t plain = add("without keys, idle", 0, {}), idle = add("with keys, idle", 0, keys);
  const std::size_t plain_loaded = add("without keys, with mesh", latency::kUnpaced, {});
  const std::size_t loaded = add("with keys, with mesh", latency::kUnpaced, keys);
  run_rounds(configurations, settings);

  char text[160];
  std::snprintf(text, sizeof text, "link %s, %d rounds, each with another order of configurations, %g s for each; %s",
                settings.link.c_str(), settings.rounds, settings.seconds, configurations[idle].note.c_str());
  Report report{{"probe states at 1 kHz", 0, 0, text}};
  for (const Configuration& configuration : configurations) {
    add_rows(report, configuration.name + ", age", configuration.age);
    if (configuration.test.load_mbit != 0)
      report.add_percentiles(configuration.name + ", mesh payload rate", "runs", "MB/s",
                             configuration.mesh_mbyte_per_s);
  }
  report.add_note("Bounds are on medians over the runs, and on the sum of lost states.");
  const auto median = [](const Samples& runs) { return runs.percentile(0.5); };
  const Population runs{"runs", configurations[idle].age.p50.size()};
  report.add_at_most("age p50, with keys minus without, idle", runs, "us",
                     median(configurations[idle].age.p50) - median(configurations[plain].age.p50), kMoreAtP50);
  report.add_at_most("age p99, with keys minus without, idle", runs, "us",
                     median(configurations[idle].age.p99) - median(configurations[plain].age.p99), kMoreAtP99);
  report.add_at_most("age p99, with keys, with mesh minus idle", runs, "us",
                     median(configurations[loaded].age.p99) - median(configurations[idle].age.p99), kLoadedMinusIdle);
  report.add_value("age p99, without keys, with mesh minus idle", runs, "us",
                   median(configurations[plain_loaded].age.p99) - median(configurations[plain].age.p99));
  report.add_at_least("mesh payload rate, with keys", runs, "MB/s", median(configurations[loaded].mesh_mbyte_per_s),
                      kMinMeshRate);
  report.add_at_most(
      "states lost, with keys",
      {"states", static_cast<std::size_t>(configurations[idle].expected + configurations[loaded].expected)}, "",
      configurations[idle].lost + configurations[loaded].lost, 0);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::RoundSettings settings;
  settings.link = "veth:rate=100";
  tactus::bench::App app{"secured", "Cost of keys: age of probe states and mesh payload rate, with and without keys",
                         "3 rounds with runs of 2 s"};
  add_round_options(app, settings, "link between the namespaces, as in `tactus-link list`");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.rounds = 3, settings.seconds = 2;
    return tactus::bench::run(settings);
  });
}
