/// One run of a scenario over a link, and its figures against the scenario's ground truth.
#pragma once

#include <atomic>

#include "client_sim/scenario.hpp"
#include "netem/profile.hpp"
#include "study/fidelity.hpp"
#include "study/subject.hpp"

namespace tactus::study {

/// Of one hand, each millisecond from when it was there.
struct Sample {
  spm::Vec3d place;
  haptics::Wrench felt, truth;
  bool exact;
};
struct ScenarioRun {
  Figures figures;
  std::vector<std::vector<Sample>> hands;  ///< by user
};

/// The object that its users touch, by name. Throws client_sim::ScenarioError when they touch several.
[[nodiscard]] std::string object_of(const client_sim::Scenario& scenario);

/// In virtual time, whatever it takes of ours. `scenario` must measure something, and `subject` be what it touches.
/// The same arguments give the same figures to the last bit. Ends early, with nothing, once `stop` is set. Throws
/// std::runtime_error when the object does not come.
[[nodiscard]] ScenarioRun run_scenario(const client_sim::Scenario& scenario, const Subject& subject,
                                       const netem::LinkSettings& link, std::uint64_t seed,
                                       const std::atomic<bool>& stop);

}  // namespace tactus::study
