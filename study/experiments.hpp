/// The experiments of a study, each with its links and seeds.
///
/// A measured scenario is one experiment. Others have no scenario: carrying a shared object with each simulation
/// method, and the search for the largest stable stiffness.
#pragma once

#include <functional>

#include "study/scenario_run.hpp"
#include "study/study.hpp"

namespace tactus::study {

/// The table to which an experiment belongs.
enum class Topic : std::uint8_t { kForces, kTool, kFirstTouch, kTarget, kLift, kHandOver, kCollaboration, kStiffness };
inline constexpr const char* kTopicNames[]{
    "Force fidelity", "Force and torque of a tool",  "Cold start", "Target force", "Lift", "Hand-over",
    "Collaboration",  "Stiffness against round trip"};

/// The figure of the stiffness experiment that is the abscissa of its plot.
inline constexpr const char* kRoundTrip = "round trip";

struct Experiment {
  std::string name;
  Topic topic = Topic::kForces;
  std::uint64_t digest = 0;           ///< of its inputs that the program's version does not determine
  std::vector<std::string> profiles;  ///< the baseline first
  std::uint32_t seeds = 1;
  std::function<ScenarioRun(const netem::LinkSettings&, std::uint64_t seed, const std::atomic<bool>& stop)> run;
};

/// The experiments of a study that passed `check`, and their objects; several threads may run them.
struct Experiments {
  std::vector<Subject> subjects;
  std::vector<Experiment> all;
};
/// Builds the models. Throws spm::ModelError.
[[nodiscard]] Experiments experiments_of(const Study& study, const std::vector<client_sim::Scenario>& scenarios);

}  // namespace tactus::study
