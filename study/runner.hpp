/// Runs the experiments of a study on several threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

#include "study/experiments.hpp"
#include "study/results.hpp"
#include "study/study.hpp"

namespace tactus::study {

/// A finished run, and the number of finished runs among the runs that were to be done.
struct FinishedRun {
  const Run& run;
  const ScenarioRun& traces;
  std::size_t done, all;
};

struct RunnerSettings {
  unsigned jobs = 0;  ///< number of parallel runs; 0: one per processor
  /// Returns whether a run is omitted. Null: none.
  std::function<bool(const Experiment& experiment, const std::string& profile, std::uint64_t seed)> omits;
  /// Receives each run. One thread of the runner at a time calls it.
  std::function<void(const FinishedRun& finished)> on_run;
};

/// Runs all experiments over their links and seeds. The outer loop is over seeds, so that an interrupted study is a
/// complete study with fewer seeds. If `cancelled` becomes true, returns early; runs in progress are not reported.
/// Throws the error of the first failed run, after all runs in progress have ended: std::runtime_error with experiment,
/// link and seed, or the exception of `on_run`.
void run_all(const Study& study, const Experiments& experiments, const RunnerSettings& settings,
             const std::atomic<bool>& cancelled);

}  // namespace tactus::study
