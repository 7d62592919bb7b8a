/// What a study consists of: experiments, each with the links and seeds that it is run for.
///
/// A measured scenario is one; so are, of tables that no scenario writes, the carrying of a shared object by each way
/// to simulate it, and the search for the largest stable stiffness.
#pragma once

#include <functional>

#include "study/scenario_run.hpp"
#include "study/study.hpp"

namespace tactus::study {

/// To which table an experiment belongs.
enum class Topic : std::uint8_t { kForces, kTool, kFirstTouch, kTarget, kLift, kHandOver, kCollaboration, kStiffness };
inline constexpr const char* kTopicNames[]{
    "Force fidelity", "Force and torque of a tool",  "Cold start", "Target force", "Lift", "Hand-over",
    "Collaboration",  "Stiffness against round trip"};

/// Of the stiffness experiment: the figure that its others are drawn over.
inline constexpr const char* kRoundTrip = "round trip";

struct Experiment {
  std::string name;
  Topic topic = Topic::kForces;
  std::uint64_t digest = 0;           ///< of what it does, as far as the program does not say
  std::vector<std::string> profiles;  ///< the baseline first
  std::uint32_t seeds = 1;
  std::function<ScenarioRun(const netem::LinkSettings&, std::uint64_t seed, const std::atomic<bool>& stop)> run;
};

/// Those of a study that `check` has accepted, with what they touch; runs may go on in several threads.
struct Experiments {
  std::vector<Subject> subjects;
  std::vector<Experiment> all;
};
/// Makes the models. Throws spm::ModelError.
[[nodiscard]] Experiments experiments_of(const Study& study, const std::vector<client_sim::Scenario>& scenarios);

}  // namespace tactus::study
