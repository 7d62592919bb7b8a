/// Runs scenarios whose users share a moving object. docs/how-to/studies.md defines each figure.
#pragma once

#include <atomic>

#include "study/scenario_run.hpp"

namespace tactus::study {

/// Runs users who press the object from several sides, each with the force of its action `hold`. Virtual time. The same
/// arguments give the same figures to the bit. If `cancelled` becomes true, returns early with an empty result.
[[nodiscard]] ScenarioRun press_to_target(const client_sim::Scenario& scenario, const Subject& subject,
                                          const netem::LinkSettings& link, std::uint64_t seed,
                                          const std::atomic<bool>& cancelled);

/// Runs users who lift the object together, each by its action `lift`. All else is as in press_to_target.
[[nodiscard]] ScenarioRun lift_together(const client_sim::Scenario& scenario, const Subject& subject,
                                        const netem::LinkSettings& link, std::uint64_t seed,
                                        const std::atomic<bool>& cancelled);

/// Returns the user's first action of `kind`. The user must have one.
[[nodiscard]] const client_sim::Action& action_of(const client_sim::User& user, client_sim::ActionKind kind);

}  // namespace tactus::study
