/// Runs tests of tactus-latency for several configurations in turn, so that changes of the machine's load affect all
/// configurations alike.
///
/// The tests run between two network namespaces, so they need root. Times are in microseconds (latency/run.hpp). One
/// thread.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "latency/run.hpp"
#include "realtime/process.hpp"
#include "wire/participants.hpp"

namespace tactus::bench {

struct RoundSettings {
  std::string link;
  int rounds = 10;
  double seconds = 5;  ///< duration of each run
};

inline void add_round_options(App& app, RoundSettings& settings, const char* link_help) {
  app.add_option("--pairs", settings.rounds, "number of rounds; each runs every configuration once")
      ->check(CLI::Range(1, 100));
  app.add_option("--seconds", settings.seconds, "duration of each run, s")
      ->check(tactus::wire::finite_range(1.0, 60.0));
  app.add_option("--link", settings.link, link_help);
}

[[nodiscard]] inline latency::RunSettings run_settings() {
  latency::RunSettings settings;
  settings.side.qos = wire::default_qos_directory();
  return settings;
}

/// A configuration under test, and the results of its runs.
struct Configuration {
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
  latency::TestCase test;
  int round_interval = 1;        ///< the configuration runs in every `round_interval`-th round
  std::filesystem::path keys{};  ///< of latency::SideSettings
  Percentiles age{}, half_round_trip{}, half_round_trip_sent{};
  Samples mesh_mbyte_per_s{};
  double expected = 0, lost = 0, echoes_lost = 0;  ///< probe states of all runs
  std::string note{};                              ///< states the real-time priority

  void add(const latency::Result& run) {
    age.add(run.age);
    half_round_trip.add(run.half_round_trip);
    half_round_trip_sent.add(run.half_round_trip_sent);
    mesh_mbyte_per_s.add(run.load_mbyte_per_s);
    expected += static_cast<double>(run.expected);
    lost += static_cast<double>(run.lost);
    echoes_lost += static_cast<double>(run.echoes_lost);
    note = run.notes.front();
  }
  [[nodiscard]] double delivered_percent() const { return 100 - 100 * lost / expected; }
};

/// Runs every configuration once in each round. The order rotates from round to round.
inline void run_rounds(std::vector<Configuration>& configurations, const RoundSettings& settings) {
  latency::RunSettings run_options = run_settings();
  for (int round = 0; round < settings.rounds; ++round) {
    std::fprintf(stderr, "round %d of %d\n", round + 1, settings.rounds);
    for (std::size_t i = 0; i < configurations.size(); ++i) {
      Configuration& configuration = configurations[(i + static_cast<std::size_t>(round)) % configurations.size()];
      if (round % configuration.round_interval != 0) continue;
      configuration.test.seconds = settings.seconds;
      run_options.side.keys = configuration.keys;
      configuration.add(latency::run_locally(configuration.test, run_options, realtime::stop_signal()));
    }
  }
}

/// Adds rows with the distribution of each percentile over the runs.
inline void add_rows(Report& report, const std::string& quantity, const Configuration::Percentiles& percentiles) {
  for (const auto& [percentile, samples] : {std::pair{": p50 of each run", &percentiles.p50},
                                            {": p99 of each run", &percentiles.p99},
                                            {": p99.9 of each run", &percentiles.p999},
                                            {": max of each run", &percentiles.max}})
    report.add_percentiles(quantity + percentile, "runs", "us", *samples);
}

/// Calls bench_main. If realtime::stop_signal is set when `run` throws or returns, it counts as interrupted, because rows
/// may be missing.
template <class Run>
int latency_main(App& app, int argc, char** argv, Run&& run) {
  return bench_main(app, argc, argv, [&]() -> Report {
    try {
      Report report = run();
      if (realtime::stop_signal()) throw Interrupted{};
      return report;
    } catch (const std::exception&) {
      if (realtime::stop_signal()) throw Interrupted{};
      throw;
    }
  });
}

}  // namespace tactus::bench
