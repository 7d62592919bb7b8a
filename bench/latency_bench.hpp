/// What the benchmarks have in common that run tactus-latency's cells: options, where they run, how they end.
///
/// Between two namespaces, which needs root; times in microseconds as latency/run.hpp has them. One thread.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "latency/run.hpp"
#include "wire/links.hpp"
#include "wire/process.hpp"

namespace tactus::bench {

/// Of a benchmark of alternating pairs of runs.
struct PairSettings {
  std::string json, link;
  int pairs = 10;
  double seconds = 5;  ///< of each run
};

inline void add_pair_options(CLI::App& app, PairSettings& settings, const char* link_text) {
  app.add_option("--pairs", settings.pairs, "alternating pairs of runs")->check(CLI::Range(1, 100));
  app.add_option("--seconds", settings.seconds, "of each run")->check(CLI::Range(1.0, 60.0));
  app.add_option("--link", settings.link, link_text);
  app.add_option("--json", settings.json, "the figures as JSON");
}

[[nodiscard]] inline latency::RunSettings run_settings() {
  latency::RunSettings settings;
  settings.place.qos = wire::default_qos_directory();
  return settings;
}

/// Parses, calls `run` and gives the exit status: 2 for wrong input and for what went wrong, 130 when interrupted.
template <class Run>
int latency_main(CLI::App& app, const char* program, int argc, char** argv, Run&& run) {
  try {
    app.parse(argc, argv);
    return run();
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", program, error.what());
    return wire::stop_signal() ? 130 : 2;
  }
}

}  // namespace tactus::bench
