// Studies in virtual time, and their tables.
#include "study/study.hpp"

#include <pybind11/stl.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <tuple>
#include <utility>

#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "study/runner.hpp"
#include "study/scenario_run.hpp"

namespace tactus::python {
namespace {

/// One millisecond of a hand and of its ground truth. World frame, SI.
struct TraceRow {
  std::array<double, 3> position, force, true_force, torque, true_torque;
  bool exact;
};

using Names = std::optional<std::vector<std::string>>;

/// A study whose models are built.
class ScriptStudy {
 public:
  explicit ScriptStudy(study::Study settings) : study_{std::move(settings)} {
    const std::vector<client_sim::Scenario> scenarios = study::check(study_);
    experiments_ = study::experiments_of(study_, scenarios);
  }

  /// Runs all experiments without the interpreter's lock, and calls `progress` in this thread.
  [[nodiscard]] std::vector<study::Run> run(unsigned jobs, const py::object& progress) const {
    std::vector<study::Run> runs;
    std::atomic<bool> cancelled{false};
    std::mutex mutex;  // for the variables below and `runs`
    std::condition_variable changed;
    std::size_t done = 0, all = 0;
    bool ended = false;
    std::exception_ptr failure;
    study::RunnerSettings settings;
    settings.jobs = jobs;
    settings.on_run = [&](const study::FinishedRun& finished) {
      const std::lock_guard lock{mutex};
      runs.push_back(finished.run);
      done = finished.done;
      all = finished.all;
      changed.notify_one();
    };
    std::thread runner{[&] {
      std::exception_ptr thrown;
      try {
        study::run_all(study_, experiments_, settings, cancelled);
      } catch (...) {
        thrown = std::current_exception();
      }
      const std::lock_guard lock{mutex};
      ended = true;
      failure = thrown;
      changed.notify_one();
    }};
    // Python code runs in this thread only, so the runner's threads never wait for the interpreter's lock.
    std::size_t reported = 0;
    std::exception_ptr python_error;
    try {
      for (bool last = false; !last;) {
        std::size_t now_done, now_all;
        {
          std::unique_lock lock{mutex};
          (void)changed.wait_for(lock, std::chrono::milliseconds{100}, [&] { return ended || done > reported; });
          last = ended, now_done = done, now_all = all;
        }
        const py::gil_scoped_acquire gil;
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        if (now_done > reported && !progress.is_none()) progress(now_done, now_all);
        reported = now_done;
      }
    } catch (...) {
      python_error = std::current_exception();
      cancelled = true;
    }
    runner.join();
    if (python_error) std::rethrow_exception(python_error);
    if (failure) std::rethrow_exception(failure);
    return runs;
  }

  [[nodiscard]] const study::Experiment& experiment(const std::string& name) const {
    std::string known;
    for (const study::Experiment& one : experiments_.all) {
      if (one.name == name) return one;
      known += (known.empty() ? "" : "; ") + one.name;
    }
    throw std::invalid_argument("found experiment '" + name + "', expected one of: " + known);
  }
  [[nodiscard]] const std::vector<study::Experiment>& experiments() const noexcept { return experiments_.all; }
  [[nodiscard]] const std::string& name() const noexcept { return study_.name; }

 private:
  study::Study study_;
  study::Experiments experiments_;
};

/// The runs of a study, and their evaluation over seeds.
struct StudyResult {
  std::vector<study::Run> runs;
  std::vector<study::LinkResult> links;
};

std::shared_ptr<ScriptStudy> make_study(const std::optional<std::string>& file, const Names& profiles,
                                        const Names& scenarios, std::optional<std::uint32_t> seeds,
                                        std::optional<std::uint64_t> first_seed, const std::optional<std::string>& scan,
                                        std::optional<std::uint32_t> faces, std::optional<double> size,
                                        std::optional<bool> collaboration, std::optional<bool> stiffness) {
  const py::gil_scoped_release no_gil;
  study::Study settings = file ? study::load_study(*file) : study::Study{};
  if (profiles) settings.profiles = *profiles;
  if (scenarios) settings.scenarios = *scenarios;
  settings.seeds = seeds.value_or(settings.seeds);
  settings.first_seed = first_seed.value_or(settings.first_seed);
  settings.scan.model = scan.value_or(settings.scan.model);
  settings.scan.faces = faces.value_or(settings.scan.faces);
  settings.scan.size = size.value_or(settings.scan.size);
  settings.collaboration = collaboration.value_or(settings.collaboration);
  settings.stiffness = stiffness.value_or(settings.stiffness);
  require(settings.seeds >= 1, "seeds: found 0, expected at least 1");
  require(settings.scan.size > 0 && std::isfinite(settings.scan.size),
          "size: found " + std::to_string(settings.scan.size) + ", expected a finite number above 0");
  return std::make_shared<ScriptStudy>(std::move(settings));
}

StudyResult run_study(const ScriptStudy& self, unsigned jobs, const py::object& progress) {
  const py::gil_scoped_release no_gil;
  StudyResult result{self.run(jobs, progress), {}};
  std::map<std::string, std::size_t> order;
  for (const study::Experiment& experiment : self.experiments()) order.emplace(experiment.name, order.size());
  std::sort(result.runs.begin(), result.runs.end(), [&](const study::Run& a, const study::Run& b) {
    return std::tuple{order[a.scenario], a.profile, a.seed} < std::tuple{order[b.scenario], b.profile, b.seed};
  });
  result.links = study::results_by_link(result.runs, self.experiments());
  return result;
}

/// The rows of a table with texts and numbers. `fields`: names and formats.
py::object table_of(const py::list& rows, const py::list& fields) {
  return py::module_::import("numpy").attr("array")(rows, fields);
}

py::object runs_of(const StudyResult& self) {
  py::list rows, fields;
  for (const char* text : {"experiment", "link", "figure", "unit"}) fields.append(py::make_tuple(text, "O"));
  fields.append(py::make_tuple("seed", "u8"));
  fields.append(py::make_tuple("value", "f8"));
  for (const study::Run& run : self.runs)
    for (const study::Figure& figure : run.figures)
      rows.append(py::make_tuple(run.scenario, run.profile, figure.name, figure.unit, run.seed, figure.value));
  return table_of(rows, fields);
}

py::object table_of_result(const StudyResult& self) {
  py::list rows, fields;
  for (const char* text : {"section", "experiment", "link", "figure", "unit"}) fields.append(py::make_tuple(text, "O"));
  for (const char* number : {"mean", "low", "high"}) fields.append(py::make_tuple(number, "f8"));
  fields.append(py::make_tuple("runs", "u4"));
  for (const char* number : {"difference", "difference_low", "difference_high"})
    fields.append(py::make_tuple(number, "f8"));
  const double none = std::numeric_limits<double>::quiet_NaN();
  for (const study::LinkResult& link : self.links) {
    for (const study::FigureEstimates& figure : link.figures) {
      const study::Estimate &value = figure.value, &difference = figure.difference;
      const auto number = [none](const study::Estimate& of, double of_it) { return of.count > 0 ? of_it : none; };
      rows.append(py::make_tuple(study::kSectionNames[static_cast<int>(link.section)], link.scenario, link.profile,
                                 figure.name, figure.unit, number(value, value.mean), number(value, value.low),
                                 number(value, value.high), value.count, number(difference, difference.mean),
                                 number(difference, difference.low), number(difference, difference.high)));
    }
  }
  return table_of(rows, fields);
}

py::list trace_of(const ScriptStudy& self, const std::string& experiment, const std::string& link, std::uint64_t seed) {
  std::vector<std::vector<TraceRow>> hands;
  {
    const py::gil_scoped_release no_gil;
    const std::atomic<bool> cancelled{false};
    const study::ScenarioRun run = self.experiment(experiment).run(netem::parse_link(link), seed, cancelled);
    const auto row3 = [](const spm::Vec3d& v) { return std::array<double, 3>{v.x(), v.y(), v.z()}; };
    for (const std::vector<study::Sample>& samples : run.hands) {
      std::vector<TraceRow>& rows = hands.emplace_back();
      for (const study::Sample& s : samples)
        rows.push_back({row3(s.position), row3(s.felt.force), row3(s.truth.force), row3(s.felt.torque),
                        row3(s.truth.torque), s.exact});
    }
  }
  py::list arrays;
  for (std::vector<TraceRow>& rows : hands) arrays.append(array_of_records(std::move(rows)));
  return arrays;
}

}  // namespace

void add_study(py::module_& module) {
  set_row_type<TraceRow>({{"position", "(3,)f8", offsetof(TraceRow, position)},
                          {"force", "(3,)f8", offsetof(TraceRow, force)},
                          {"true_force", "(3,)f8", offsetof(TraceRow, true_force)},
                          {"torque", "(3,)f8", offsetof(TraceRow, torque)},
                          {"true_torque", "(3,)f8", offsetof(TraceRow, true_torque)},
                          {"exact", "?", offsetof(TraceRow, exact)}});
  py::class_<StudyResult>(module, "StudyResult", "The runs of a study, and its table.")
      .def_property_readonly("runs", &runs_of,
                             "A row for each figure of each run: experiment, link, figure, unit, seed, value.")
      .def_property_readonly("table", &table_of_result,
                             "A row for each figure of each experiment and link, over all seeds: section, experiment, "
                             "link,\nfigure, unit, mean, low, high (95 % confidence interval), runs, and the "
                             "difference from the link P0:\ndifference, difference_low, difference_high.");
  py::class_<ScriptStudy, std::shared_ptr<ScriptStudy>>(
      module, "Study",
      "A study in virtual time: scenarios over links and seeds, compared with a ground truth\n"
      "(docs/how-to/studies.md).")
      .def(py::init(&make_study), py::arg("file") = py::none(), py::kw_only(), py::arg("profiles") = py::none(),
           py::arg("scenarios") = py::none(), py::arg("seeds") = py::none(), py::arg("first_seed") = py::none(),
           py::arg("scan") = py::none(), py::arg("faces") = py::none(), py::arg("size") = py::none(),
           py::arg("collaboration") = py::none(), py::arg("stiffness") = py::none(),
           "Reads the settings, and builds the models.\n\nfile: a study in YAML; without it, the default study. The "
           "other arguments replace settings of the file. Raises\nYamlError, ScenarioError, LinkError or ModelError.")
      .def("run", &run_study, py::arg("jobs") = 0, py::arg("progress") = py::none(),
           "Runs all experiments over their links and seeds. Equal studies give equal results.\n\n"
           "jobs: parallel runs, 0 for one per processor. progress: called with the numbers of finished and of all "
           "runs.")
      .def("trace", &trace_of, py::arg("experiment"), py::arg("link") = "P0", py::arg("seed") = 1,
           "Repeats one run. Returns a structured array for each hand, with a row for each millisecond: position, "
           "force,\ntrue_force, torque, true_torque, exact.")
      .def_property_readonly(
          "experiments",
          [](const ScriptStudy& self) {
            py::dict links;
            for (const study::Experiment& experiment : self.experiments())
              links[py::str(experiment.name)] = experiment.profiles;
            return links;
          },
          "The names of the experiments, each with its links.")
      .def_property_readonly("name", &ScriptStudy::name, "Name of the study.");
}

}  // namespace tactus::python
