/// One run of a scenario over a link, and its figures compared with the scenario's ground truth.
#pragma once

#include <atomic>

#include "client_sim/scenario.hpp"
#include "netem/profile.hpp"
#include "study/fidelity.hpp"
#include "study/subject.hpp"

namespace tactus::study {

/// Of one hand, each millisecond from its start.
struct Sample {
  spm::Vec3d position;
  haptics::Wrench felt, truth;
  bool exact;
};
struct ScenarioRun {
  Figures figures;
  std::vector<std::vector<Sample>> hands;  ///< by user
};

/// The name of the object that its users touch. Throws client_sim::ScenarioError when they touch several.
[[nodiscard]] std::string object_of(const client_sim::Scenario& scenario);

/// Runs in virtual time. `scenario` must measure something, and `subject` must be its object. The same arguments give
/// the same figures to the bit. Ends early with an empty result when `stop` is set. Throws std::runtime_error when the
/// object does not arrive.
[[nodiscard]] ScenarioRun run_scenario(const client_sim::Scenario& scenario, const Subject& subject,
                                       const netem::LinkSettings& link, std::uint64_t seed,
                                       const std::atomic<bool>& stop);

}  // namespace tactus::study
