/// What the benchmarks have in common that run tactus-latency's cells: options, where they run, how they end.
///
/// Between two namespaces, which needs root; times in microseconds as latency/run.hpp has them. One thread.
#pragma once

#include <string>

#include "bench/bench_main.hpp"
#include "latency/run.hpp"
#include "wire/participants.hpp"
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
  settings.side.qos = wire::default_qos_directory();
  return settings;
}

/// bench_main for what may be interrupted: 130 then.
template <class Run>
int latency_main(CLI::App& app, const char* program, int argc, char** argv, Run&& run) {
  const int status = bench_main(app, program, argc, argv, run);
  return status == 2 && wire::stop_signal() ? 130 : status;
}

}  // namespace tactus::bench
