/// The experiments of a study, each with its links and number of seeds.
///
/// Each scenario of the study is one experiment. Two kinds of experiments have no scenario: users who carry a shared
/// object, for each simulation method, and the search for the largest stable stiffness.
#pragma once

#include <functional>

#include "study/scenario_run.hpp"
#include "study/study.hpp"

namespace tactus::study {

/// The section of the report to which an experiment belongs.
enum class Section : std::uint8_t {
  kForces,
  kTool,
  kFirstTouch,
  kTarget,
  kLift,
  kHandOver,
  kCollaboration,
  kStiffness
};
inline constexpr const char* kSectionNames[]{
    "Force fidelity", "Force and torque of a tool",  "Cold start", "Target force", "Lift", "Hand-over",
    "Collaboration",  "Stiffness against round trip"};

/// Names of the experiments without a scenario. The name of the first kind ends in a method of kMethodNames.
inline constexpr const char *kCarryPrefix = "carry, ", *kStiffnessName = "stiffness";

/// Name of the figure that is the abscissa of the stiffness plot.
inline constexpr const char* kRoundTrip = "round trip";

struct Experiment {
  std::string name;
  Section section = Section::kForces;
  std::uint64_t digest = 0;           ///< of the scenario; 0: no scenario, the program's version determines all inputs
  std::vector<std::string> profiles;  ///< links; the baseline is first
  std::uint32_t seeds = 1;
  std::function<ScenarioRun(const netem::LinkSettings&, std::uint64_t seed, const std::atomic<bool>& cancelled)> run;
};

/// The experiments of a study, and the objects that they use. Several threads may call Experiment::run.
struct Experiments {
  std::vector<Subject> subjects;
  std::vector<Experiment> all;
};
/// Builds the models of a study that `check` has accepted. Throws spm::ModelError.
[[nodiscard]] Experiments experiments_of(const Study& study, const std::vector<client_sim::Scenario>& scenarios);

}  // namespace tactus::study
