/// Runs of scenarios whose users share a moving object, and their figures. docs/how-to/studies.md defines each figure.
#pragma once

#include <atomic>

#include "study/scenario_run.hpp"

namespace tactus::study {

/// Users press the object from several sides, each with the force of its `hold`. Virtual time; the same arguments give
/// the same figures to the bit. Ends early with an empty result when `stop` is set.
[[nodiscard]] ScenarioRun press_to_target(const client_sim::Scenario& scenario, const Subject& subject,
                                          const netem::LinkSettings& link, std::uint64_t seed,
                                          const std::atomic<bool>& stop);

/// The same for users who lift it together, each by its `lift` action.
[[nodiscard]] ScenarioRun lift_together(const client_sim::Scenario& scenario, const Subject& subject,
                                        const netem::LinkSettings& link, std::uint64_t seed,
                                        const std::atomic<bool>& stop);

/// The user's first action of that kind, which must exist.
[[nodiscard]] const client_sim::Action& action_of(const client_sim::User& user, client_sim::ActionKind kind);

}  // namespace tactus::study
