#include <sys/utsname.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <thread>

#include "realtime/process.hpp"
#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "study/results.hpp"
#include "study/runner.hpp"
#include "study/scenario_run.hpp"
#include "study/study.hpp"
#include "study/tables.hpp"
#include "tactus/commit.hpp"

namespace {

using namespace tactus;
using namespace tactus::study;

constexpr int kFailed = 1, kWrongInput = 2, kInterrupted = 130;

constexpr char kExamples[] = R"(
Examples:
  tactus sim study --out out
  tactus sim study my-study.yaml --out out
  tactus sim study --only tap-scan --profiles P4 --seeds 1 --first-seed 3 --trace --out one

my-study.yaml:
  name: mine
  profiles: [P0, P4, "P0:delay=25:loss=1"]
  scenarios: [tap-scan, follow-scan, my.yaml]
  seeds: 30
  scan: {model: dragon.ply, size: 0.2}

Everything runs in virtual time. If a study was interrupted, the same command with the same folder continues it.
docs/how-to/studies.md describes how scenarios define measurements, and each figure.
Exit status: 0 done, 1 a run failed or the output could not be written, 2 wrong input, 130 interrupted. With 1 and 130
the study has written the tables of its finished runs.)";

struct Options {
  std::string file, out = "study", scan;
  std::vector<std::string> profiles, scenarios, only;
  std::uint32_t seeds = 0, faces = 0;
  std::uint64_t first_seed = 0;
  unsigned jobs = 0;
  bool trace = false;
};

Study study_of(const Options& options) {
  Study study = options.file.empty() ? Study{} : load_study(options.file);
  if (!options.profiles.empty()) study.profiles = options.profiles;
  if (!options.scenarios.empty()) study.scenarios = options.scenarios;
  if (options.seeds > 0) study.seeds = options.seeds;
  if (options.first_seed > 0) study.first_seed = options.first_seed;
  if (!options.scan.empty()) study.scan.model = options.scan;
  if (options.faces > 0) study.scan.faces = options.faces;
  return study;
}

std::string machine() {
  utsname names{};
  (void)uname(&names);
  return std::to_string(std::thread::hardware_concurrency()) + " processors, " + names.sysname + " " + names.release;
}

/// Removes the experiments that are not in `names`, unless `names` is empty. Throws client_sim::ScenarioError for an
/// unknown name.
void keep_only(const std::vector<std::string>& names, std::vector<Experiment>& experiments) {
  if (names.empty()) return;
  std::vector<Experiment> kept;
  for (const std::string& name : names) {
    const auto found = std::find_if(experiments.begin(), experiments.end(),
                                    [&](const Experiment& experiment) { return experiment.name == name; });
    if (found == experiments.end()) {
      std::string known;
      for (const Experiment& experiment : experiments) known += (known.empty() ? "" : "; ") + experiment.name;
      throw client_sim::ScenarioError{"--only: found '" + name + "', expected one of: " + known};
    }
    const bool is_kept =
        std::any_of(kept.begin(), kept.end(), [&](const Experiment& experiment) { return experiment.name == name; });
    if (!is_kept) kept.push_back(*found);
  }
  experiments = std::move(kept);
}

/// Returns a line that identifies everything that determines a run, except experiment, link and seed.
std::string identity_of(const Study& study, const Experiments& experiments) {
  nlohmann::ordered_json identity{{"study", study.name}, {"commit", TACTUS_COMMIT}};
  for (const Subject& subject : experiments.subjects) identity["models"][subject.name] = subject.model.summary.digest;
  for (const Experiment& experiment : experiments.all) identity["experiments"][experiment.name] = experiment.digest;
  return identity.dump();
}

void write_traces(const std::filesystem::path& folder, const Run& run, const ScenarioRun& traces) {
  std::filesystem::create_directories(folder);
  for (std::size_t user = 0; user < traces.hands.size(); ++user) {
    std::string text =
        "time_s,x,y,z,force_x,force_y,force_z,true_x,true_y,true_z,exact,"
        "torque_x,torque_y,torque_z,true_torque_x,true_torque_y,true_torque_z\n";
    for (std::size_t ms = 0; ms < traces.hands[user].size(); ++ms) {
      const Sample& s = traces.hands[user][ms];
      const haptics::Wrench &f = s.felt, &t = s.truth;
      char line[400];
      std::snprintf(line, sizeof line,
                    "%.3f,%.7g,%.7g,%.7g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n",
                    static_cast<double>(ms) * 1e-3, s.position.x(), s.position.y(), s.position.z(), f.force.x(),
                    f.force.y(), f.force.z(), t.force.x(), t.force.y(), t.force.z(), s.exact ? 1 : 0, f.torque.x(),
                    f.torque.y(), f.torque.z(), t.torque.x(), t.torque.y(), t.torque.z());
      text += line;
    }
    write_file(folder / trace_file_name(run, user), text);
  }
}

int run(const Options& options, const std::string& command, const std::atomic<bool>& cancelled) {
  Study study = study_of(options);
  const std::vector<client_sim::Scenario> scenarios = check(study);
  std::fprintf(stderr, "building the models\n");
  Experiments experiments = experiments_of(study, scenarios);
  keep_only(options.only, experiments.all);
  const std::filesystem::path folder{options.out};
  RunLog log{folder, identity_of(study, experiments)};
  RunnerSettings runner;
  runner.jobs = options.jobs;
  runner.omits = [&log](const Experiment& experiment, const std::string& profile, std::uint64_t seed) {
    return log.has(experiment.name, profile, seed);
  };
  runner.on_run = [&](const FinishedRun& finished) {
    const Run& run = finished.run;
    try {
      // The study never repeats a run of the log, so the traces precede it.
      if (options.trace) write_traces(folder / "traces", run, finished.traces);
    } catch (const std::exception& error) {
      log.add(run);
      throw std::runtime_error("the traces of " + run.scenario + " over " + run.profile + ", seed " +
                               std::to_string(run.seed) + ", could not be written: " + error.what());
    }
    log.add(run);
    std::fprintf(stderr, "[%zu/%zu] %s over %s, seed %llu\n", finished.done, finished.all,
                 session::printable(run.scenario).c_str(), run.profile.c_str(),
                 static_cast<unsigned long long>(run.seed));
  };
  std::string failure;
  try {
    run_all(study, experiments, runner, cancelled);
  } catch (const std::exception& error) {
    failure = session::printable(error.what());
    std::fprintf(stderr, "tactus-study: %s\n", failure.c_str());
  }

  About about{study.name, command, machine(), TACTUS_COMMIT, {}};
  for (const Subject& subject : experiments.subjects)
    about.notes.push_back("The " + subject.name + ": " + subject.source + ".");
  const std::string file = options.file.empty() ? "" : options.file + " ";
  about.notes.push_back(
      "Virtual time: the code of the programs, without threads, sockets, discovery and effects of the machine. "
      "`scripts/bench wide-area` runs live sessions over the same links.");
  about.notes.push_back(
      "Each figure is a mean over seeds with its 95 % confidence interval. To repeat one run: `tactus sim study " +
      file + "--only NAME --profiles LINK --seeds 1 --first-seed SEED --trace --out FOLDER`.");
  const bool failed = !failure.empty();
  if (failed) {
    about.notes.push_back("A run failed, so some runs are missing: " + failure);
  } else if (cancelled) {
    about.notes.push_back("Interrupted: some seeds are missing.");
  }
  const int status = failed ? kFailed : cancelled ? kInterrupted : 0;
  const char* const reason = failed ? "a run failed" : "interrupted";
  const std::vector<LinkResult> results = results_by_link(log.runs(), experiments.all);
  if (results.empty()) {
    std::fprintf(stderr, "tactus-study: %s before the first run finished\n", reason);
    return status;
  }
  const std::string tables = markdown(about, results);
  write_file(folder / "tables.md", tables);
  write_file(folder / "index.html", html(about, results));
  write_file(folder / "results.csv", csv(results));
  write_file(folder / "study.json", json(about, results));
  std::cout << tables;
  if (status != 0) std::fprintf(stderr, "tactus-study: %s; finished runs are in %s\n", reason, folder.c_str());
  return status;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{"Runs a study over links, scenarios and seeds: compares forces on hands with ground truth, in tables.",
               "tactus sim study"};
  app.footer(kExamples);
  app.add_option("STUDY", options.file, "A study in YAML; default: a small study of two minutes");
  app.add_option("--out", options.out, "Folder for runs and tables")->capture_default_str();
  app.add_option("--profiles", options.profiles, "Links to use instead of the study's, as in `tactus link list`")
      ->delimiter(',');
  app.add_option("--scenarios", options.scenarios,
                 "Scenarios to run instead of the study's: built-in ones or YAML files")
      ->delimiter(',');
  app.add_option("--only", options.only,
                 "Run only the experiment of this name, such as tap-scan, 'carry, channel' or stiffness; repeatable")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_option("--seeds", options.seeds, "Number of seeds instead of the study's")->check(CLI::Range(1, 10000));
  app.add_option("--first-seed", options.first_seed, "First seed instead of the study's")
      ->check(CLI::Range(1, 1000000000));
  app.add_option("--scan", options.scan, "Scan to use instead of the study's: a model file or a generated shape");
  app.add_option("--faces", options.faces, "Faces of a generated scan")->check(CLI::Range(1000, 30000000));
  app.add_option("--jobs", options.jobs, "Number of parallel runs; 0: number of processors")->check(CLI::Range(0, 256));
  app.add_flag("--trace", options.trace, "Also write each hand's positions and forces, one line per millisecond");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongInput;
  }
  std::string command = "tactus sim study";
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    command += word.find(' ') == std::string::npos ? " " + word : " '" + word + "'";
  }
  const std::atomic<bool>& cancelled = realtime::stop_signal();
  try {
    return realtime::status_after_output("tactus-study", run(options, command, cancelled));
  } catch (const std::exception& error) {
    std::cerr << "tactus-study: " << session::printable(error.what()) << '\n';
    return kWrongInput;
  }
}
