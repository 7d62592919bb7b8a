/// Common parts of the benchmarks that run tests of tactus-latency: options, and runs of several kinds in turn.
///
/// Between two namespaces, which needs root; times in microseconds, see latency/run.hpp. One thread.
#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "latency/run.hpp"
#include "wire/participants.hpp"
#include "wire/process.hpp"

namespace tactus::bench {

/// Of a benchmark of several kinds of runs, one of each kind to a pair.
struct PairSettings {
  std::string link;
  int pairs = 10;
  double seconds = 5;  ///< of each run
};

inline void add_pair_options(App& app, PairSettings& settings, const char* link_text) {
  app.add_option("--pairs", settings.pairs, "rounds of runs")->check(CLI::Range(1, 100));
  app.add_option("--seconds", settings.seconds, "of each run")->check(CLI::Range(1.0, 60.0));
  app.add_option("--link", settings.link, link_text);
}

[[nodiscard]] inline latency::RunSettings run_settings() {
  latency::RunSettings settings;
  settings.side.qos = wire::default_qos_directory();
  return settings;
}

/// The runs of one kind.
struct Runs {
  struct Percentiles {
    Samples p50, p99, p999, max;
    void add(const latency::Summary& run) {
      p50.add(run.p50);
      p99.add(run.p99);
      p999.add(run.p999);
      max.add(run.max);
    }
  };

  std::string name;
  latency::Cell cell;
  int every = 1;  ///< runs in every so many rounds only
  Percentiles age{}, half_round_trip{}, half_round_trip_sent{};
  Samples mesh{};  ///< MB/s
  double expected = 0, lost = 0, echoes_lost = 0;
  std::string note{};  ///< about real-time priority

  void add(const latency::Result& run) {
    age.add(run.age);
    half_round_trip.add(run.half_round_trip);
    half_round_trip_sent.add(run.half_round_trip_sent);
    mesh.add(run.load_mbyte_per_s);
    expected += static_cast<double>(run.expected);
    lost += static_cast<double>(run.lost);
    echoes_lost += static_cast<double>(run.echoes_lost);
    note = run.notes.front();
  }
  [[nodiscard]] double delivered_percent() const { return 100 - 100 * lost / expected; }
};

/// Runs every kind once in each round, in an order that rotates from round to round.
inline void run_in_turn(std::vector<Runs>& kinds, const PairSettings& settings) {
  const latency::RunSettings here = run_settings();
  for (int round = 0; round < settings.pairs; ++round) {
    std::fprintf(stderr, "round %d of %d\n", round + 1, settings.pairs);
    for (std::size_t i = 0; i < kinds.size(); ++i) {
      Runs& kind = kinds[(i + static_cast<std::size_t>(round)) % kinds.size()];
      if (round % kind.every != 0) continue;
      kind.cell.seconds = settings.seconds;
      kind.add(latency::run_here(kind.cell, here, wire::stop_signal()));
    }
  }
}

inline void add_rows(Report& report, const std::string& name, const std::string& population,
                     const Runs::Percentiles& of) {
  for (const auto& [percentile, samples] : {std::pair{" p50 of a run", &of.p50},
                                            {" p99 of a run", &of.p99},
                                            {" p99.9 of a run", &of.p999},
                                            {" max of a run", &of.max}})
    report.row(name + percentile, population, "us", *samples);
}

/// bench_main for a benchmark that stops on wire::stop_signal: 130 then.
template <class Run>
int latency_main(App& app, int argc, char** argv, Run&& run) {
  return bench_main(app, argc, argv, [&]() -> Report {
    try {
      return run();
    } catch (const std::exception&) {
      if (wire::stop_signal()) throw Interrupted{};
      throw;
    }
  });
}

}  // namespace tactus::bench
