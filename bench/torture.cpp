// Splits, collapses, loads, evicts and reloads records in random order. Checks that the refined regions determine the
// mesh.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/models.hpp"
#include "bench/torture_run.hpp"

namespace tactus::bench {
namespace {

struct Settings {
  std::string model;
  std::uint32_t faces = 70000;
  TortureSettings torture;
  bool quick = false;
};

Report run(const Settings& settings) {
  std::fprintf(stderr, "building the model\n");
  const LoadedModel subject = load_model(settings.model, settings.faces);
  std::fprintf(stderr, "%llu operations\n", static_cast<unsigned long long>(settings.torture.operations));
  const TortureResult result = torture(subject.model, settings.torture);
  for (const std::string& problem : result.problems) std::fprintf(stderr, "%s\n", problem.c_str());

  char text[128];
  std::snprintf(text, sizeof text, "pool %g of the model's records, seed %llu", settings.torture.pool_share,
                static_cast<unsigned long long>(settings.torture.seed));
  Report report{{subject.name, subject.model.summary.digest, subject.model.summary.faces, text}};
  const Population operations{"operations", result.operations()}, steps{"steps", result.steps};
  const Population regions{"regions of the model", subject.model.summary.regions};
  const auto add_count = [&](const char* name, const Population& of, auto value) {
    report.add_value(name, of, "", static_cast<double>(value));
  };
  add_count("operations", operations, result.operations());
  add_count("records split", operations, result.splits);
  add_count("records collapsed", operations, result.collapses);
  add_count("records loaded", operations, result.loaded);
  add_count("records evicted", operations, result.evicted);
  add_count("records loaded again", operations, result.reloaded);
  add_count("records received that were loaded already", steps, result.repeated);
  add_count("regions loaded", steps, result.regions_loaded);
  add_count("regions evicted", steps, result.regions_evicted);
  add_count("regions refused by a full pool", steps, result.refused_full);
  add_count("steps", steps, result.steps);
  add_count("steps that ended at their budget", steps, result.cut_by_budget);
  add_count("regions refined at the end", regions, result.regions_at_end);
  report.add_value("wall time of an operation, without checks", operations, "us",
                   result.seconds * 1e6 / static_cast<double>(result.operations()));

  report.add_at_least("operations", operations, "", static_cast<double>(result.operations()),
                      static_cast<double>(settings.torture.operations));
  report.add_at_least("regions refined at the end", regions, "", result.regions_at_end, 1);
  report.add_at_least("checks of all invariants", {"checks", result.checks}, "", result.checks,
                      settings.torture.checks);
  report.add_at_most("violations", {"checks", result.checks}, "", static_cast<double>(result.problems.size()), 0);
  report.add_at_most("mesh hashes that differ from that of the refined regions", {"run", 1}, "",
                     result.hash == result.expected_hash ? 0 : 1, 0);
  report.add_at_most("mesh hashes that differ from that of a new forest", {"run", 1}, "",
                     result.hash == result.fresh_hash ? 0 : 1, 0);
  report.add_at_least("faces compared with those of a new forest", {"faces", result.faces_compared}, "",
                      static_cast<double>(result.faces_compared), 1);
  report.add_at_most("faces that differ from those of a new forest", {"faces", result.faces_compared}, "",
                     static_cast<double>(result.faces_different), 0);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  settings.torture.operations = 100'000'000;
  tactus::bench::App app{
      "torture", "Splits, collapses, loads, evicts and reloads records in random order and checks the final mesh",
      "10^6 operations, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--operations", settings.torture.operations,
                 "number of records split, collapsed, loaded, evicted or reloaded");
  app.add_option("--pool-share", settings.torture.pool_share, "pool divided by the model's records")
      ->check(tactus::wire::finite_range(0.01, 1.0));
  app.add_option("--checks", settings.torture.checks, "number of checks of all invariants before the end")
      ->check(CLI::Range(1, 1000));
  app.add_option("--seed", settings.torture.seed, "seed of the order");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.torture.operations = std::min<std::uint64_t>(settings.torture.operations, 1'000'000);
    return tactus::bench::run(settings);
  });
}
