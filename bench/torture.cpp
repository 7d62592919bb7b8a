// Split, collapse, load, evict and reload in any order: must end in the mesh that the set of regions determines.
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
  std::fprintf(stderr, "making the model\n");
  const LoadedModel subject = load_model(settings.model, settings.faces);
  std::fprintf(stderr, "%llu operations\n", static_cast<unsigned long long>(settings.torture.operations));
  const TortureResult result = torture(subject.model, settings.torture);
  for (const std::string& problem : result.problems) std::fprintf(stderr, "%s\n", problem.c_str());

  char text[128];
  std::snprintf(text, sizeof text, "pool %g of the model, seed %llu", settings.torture.pool_share,
                static_cast<unsigned long long>(settings.torture.seed));
  Report report{{subject.name, subject.model.summary.digest, subject.model.summary.faces, text}};
  const auto count = [&](const char* name, const char* of, auto value) {
    report.figure(name, of, "", static_cast<double>(value));
  };
  count("operations", "records", result.operations());
  count("split", "records", result.splits);
  count("collapsed", "records", result.collapses);
  count("loaded", "records", result.loaded);
  count("evicted", "records", result.evicted);
  count("loaded again", "records", result.reloaded);
  count("sent although here", "records", result.repeated);
  count("loaded", "regions", result.regions_loaded);
  count("evicted", "regions", result.regions_evicted);
  count("refused, pool full", "regions", result.refused_full);
  count("steps", "all", result.steps);
  count("steps cut by their budget", "all", result.cut_by_budget);
  count("refined at the end", "regions", result.regions_at_end);
  report.figure("time, checks apart", "an operation", "us",
                result.seconds * 1e6 / static_cast<double>(result.operations()));

  report.at_least("operations", "records", "", static_cast<double>(result.operations()),
                  static_cast<double>(settings.torture.operations));
  report.at_least("regions refined", "at the end", "", result.regions_at_end, 1);
  report.at_least("recounts", "on the way", "", result.checks, settings.torture.checks);
  report.at_most("problems", {"recounts", result.checks}, "", static_cast<double>(result.problems.size()), 0);
  report.at_most("mesh hash differs from the recomputed", "at the end", "", result.hash == result.expected_hash ? 0 : 1,
                 0);
  report.at_most("mesh hash differs from a fresh forest's", "at the end", "", result.hash == result.fresh_hash ? 0 : 1,
                 0);
  report.at_least("faces compared with a fresh forest's", "at the end", "", static_cast<double>(result.faces_compared),
                  1);
  report.at_most("faces that differ", {"at the end", result.faces_compared}, "",
                 static_cast<double>(result.faces_different), 0);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  settings.torture.operations = 100'000'000;
  tactus::bench::App app{
      "torture", "Split, collapse, load, evict and reload in any order, ending where the set of regions alone says",
      "10^6 operations, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--operations", settings.torture.operations, "records split, collapsed, loaded, evicted, reloaded");
  app.add_option("--pool-share", settings.torture.pool_share, "pool, as a share of the model's records")
      ->check(CLI::Range(0.01, 1.0));
  app.add_option("--checks", settings.torture.checks, "recounts of everything on the way")->check(CLI::Range(1, 1000));
  app.add_option("--seed", settings.torture.seed, "of the order");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.torture.operations = std::min<std::uint64_t>(settings.torture.operations, 1'000'000);
    return tactus::bench::run(settings);
  });
}
