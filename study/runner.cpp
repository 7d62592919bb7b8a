#include "study/runner.hpp"

#include <algorithm>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace tactus::study {
namespace {

class Runner {
 public:
  Runner(const Study& study, const Experiments& experiments, const RunnerSettings& settings) : settings_{settings} {
    for (std::uint32_t i = 0; i < study.seeds; ++i)
      for (const Experiment& experiment : experiments.all)
        for (const std::string& profile : experiment.profiles)
          if (i < experiment.seeds && !(settings.omits && settings.omits(experiment, profile, study.first_seed + i)))
            left_.push_back({&experiment, profile, study.first_seed + i});
  }

  void run(const std::atomic<bool>& cancelled) {
    const unsigned jobs = settings_.jobs > 0 ? settings_.jobs : std::max(1u, std::thread::hardware_concurrency());
    std::vector<std::thread> threads;
    for (unsigned i = 0; i < jobs; ++i) threads.emplace_back([&] { work(cancelled); });
    for (std::thread& thread : threads) thread.join();
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  struct Task {
    const Experiment* experiment;
    std::string profile;
    std::uint64_t seed;
  };
  /// Adds experiment, link and seed to the message of an error.
  static ScenarioRun result_of(const Task& task, const std::atomic<bool>& cancelled) try {
    return task.experiment->run(netem::parse_link(task.profile), task.seed, cancelled);
  } catch (const std::exception& error) {
    throw std::runtime_error(task.experiment->name + " over " + task.profile + ", seed " + std::to_string(task.seed) +
                             ": " + error.what());
  }
  void work(const std::atomic<bool>& cancelled) {
    for (std::size_t i = next_++; i < left_.size() && !cancelled && !failed_; i = next_++) {
      const Task& task = left_[i];
      try {
        const ScenarioRun result = result_of(task, cancelled);
        if (cancelled) return;
        const Run run{task.experiment->name, task.profile, task.seed, result.figures};
        const std::lock_guard lock{mutex_};
        settings_.on_run({run, result, ++done_, left_.size()});
      } catch (...) {
        const std::lock_guard lock{mutex_};
        if (!failed_) failure_ = std::current_exception();
        failed_ = true;
      }
    }
  }

  const RunnerSettings& settings_;
  std::vector<Task> left_;
  std::atomic<std::size_t> next_{0};
  std::atomic<bool> failed_{false};
  std::mutex mutex_;  // for the members below and calls of on_run
  std::size_t done_ = 0;
  std::exception_ptr failure_;
};

}  // namespace

void run_all(const Study& study, const Experiments& experiments, const RunnerSettings& settings,
             const std::atomic<bool>& cancelled) {
  Runner{study, experiments, settings}.run(cancelled);
}

}  // namespace tactus::study
