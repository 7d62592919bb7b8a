/// Runs of scenarios whose users share an object that moves, and their figures. docs/how-to/studies.md has what each
/// means.
#pragma once

#include <atomic>

#include "study/scenario_run.hpp"

namespace tactus::study {

/// Users who press the object from several sides, each with the force of its `hold`. In virtual time, whatever it
/// takes of ours; the same arguments give the same figures to the last bit. Ends early, with nothing, once `stop` is
/// set.
[[nodiscard]] ScenarioRun press_to_target(const client_sim::Scenario& scenario, const Subject& subject,
                                          const netem::LinkSettings& link, std::uint64_t seed,
                                          const std::atomic<bool>& stop);

/// The same of users who lift it together, each as its `lift` says.
[[nodiscard]] ScenarioRun lift_together(const client_sim::Scenario& scenario, const Subject& subject,
                                        const netem::LinkSettings& link, std::uint64_t seed,
                                        const std::atomic<bool>& stop);

/// The user's first action of that kind, which it must have.
[[nodiscard]] const client_sim::Action& action_of(const client_sim::User& user, client_sim::ActionKind kind);

}  // namespace tactus::study
