/// Runs a scenario over a link and compares its forces with their ground truth.
#pragma once

#include <atomic>

#include "client_sim/scenario.hpp"
#include "netem/profile.hpp"
#include "study/fidelity.hpp"
#include "study/subject.hpp"

namespace tactus::study {

/// One millisecond of a hand.
struct Sample {
  spm::Vec3d position;
  haptics::Wrench felt, truth;  ///< wrench of the session, and wrench of the ground truth
  bool exact;                   ///< the contact was exact
};
struct ScenarioRun {
  Figures figures;
  std::vector<std::vector<Sample>> hands;  ///< by user; begins with the millisecond in which the hand appeared
};

/// Returns the name of the object that the users touch. Throws client_sim::ScenarioError unless they touch exactly
/// one object.
[[nodiscard]] std::string object_of(const client_sim::Scenario& scenario);

/// Runs the scenario in virtual time. `scenario.measures` must not be kNone, and `subject` must be the object that its
/// users touch. The same arguments give the same figures to the bit. If `cancelled` becomes true, returns early with an
/// empty result. Throws std::runtime_error if the base mesh does not arrive within a minute.
[[nodiscard]] ScenarioRun run_scenario(const client_sim::Scenario& scenario, const Subject& subject,
                                       const netem::LinkSettings& link, std::uint64_t seed,
                                       const std::atomic<bool>& cancelled);

}  // namespace tactus::study
