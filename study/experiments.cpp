#include "study/experiments.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "study/hand_over.hpp"
#include "study/shared_run.hpp"
#include "study/shared_world.hpp"
#include "study/stiffness.hpp"

namespace tactus::study {
namespace {

using client_sim::ActionKind;
using client_sim::Measure;
using client_sim::Scenario;

/// Returns a world with the slower direction of `link` between each pair of participants.
WorldSettings world_for(const netem::LinkSettings& link, std::size_t users, std::uint64_t seed) {
  constexpr double kDeviations = 2.3;  // as in a session, 99 % of the samples arrive within the playout delay
  WorldSettings world;
  world.users = users;
  world.link = link.a_to_b.delay_ms >= link.b_to_a.delay_ms ? link.a_to_b : link.b_to_a;
  world.playout = (world.link.delay_ms + kDeviations * world.link.jitter_ms + 1) * 1e-3;  // + 1 ms: a cycle
  world.seed = seed;
  return world;
}

ScenarioRun run_hand_over(const Scenario& scenario, const netem::LinkSettings& link, std::uint64_t seed) {
  std::vector<HandOverUser> users;
  for (const client_sim::User& user : scenario.users)
    users.push_back({action_of(user, ActionKind::kHold).seconds, action_of(user, ActionKind::kWait).seconds});
  return {hand_over(users, scenario.duration, link, seed), {}};
}

ScenarioRun carry_together(Method method, const netem::LinkSettings& link, std::uint64_t seed) {
  constexpr double kSeconds = 12, kFrequency = 0.5;
  WorldSettings world = world_for(link, 2, seed);
  world.method = method;
  const CarryResult carried = carry(world, kSeconds);
  const MassResult mass = apparent_mass(world, kFrequency);
  const double none = std::numeric_limits<double>::quiet_NaN();
  const auto if_settled = [&](double value) { return carried.settles ? value : none; };
  // The mass is meaningless if the copy diverges or hardly moves.
  const double ratio = mass.mass / world.mass;
  const bool has_mass = carried.settles && std::isfinite(ratio) && std::abs(ratio) > 1e-3 && std::abs(ratio) < 100;
  return {{{"diverged runs", "%", carried.settles ? 0.0 : 100.0},
           {"time to settle", "s", if_settled(carried.settling_time)},
           {"distance of copies 1 s later", "mm", if_settled(carried.end_copy_distance * 1e3)},
           {"largest distance of copies", "mm", if_settled(carried.max_copy_distance * 1e3)},
           {"injected energy", "mJ a minute", if_settled(carried.injected * 1e3 * 60 / kSeconds)},
           {"peak force", "N", if_settled(carried.peak_force)},
           {"apparent mass / mass", "", has_mass ? ratio : none},
           {"apparent damping", "N s/m", has_mass ? mass.damping : none}},
          {}};
}

ScenarioRun find_stiffness(const netem::LinkSettings& link) {
  const Stiffness found = largest_stable_stiffness((link.a_to_b.delay_ms + link.b_to_a.delay_ms) * 1e-3, 9);
  return {{{kRoundTrip, "ms", link.a_to_b.delay_ms + link.b_to_a.delay_ms},
           {"wall, bound: (b + B) / (T/2 + td)", "N/m", found.wall_bound},
           {"wall, delayed force", "N/m", found.wall},
           {"wall, passivity controller", "N/m", found.wall_passivity},
           {"copies, bound: 0.8 x 2 B / (RTT + T)", "N/m", found.copies_bound},
           {"copies, naive", "N/m", found.copies_naive},
           {"copies, set position", "N/m", found.copies_set},
           {"copies, channel", "N/m", found.copies_channel}},
          {}};
}

}  // namespace

Experiments experiments_of(const Study& study, const std::vector<Scenario>& scenarios) {
  Experiments experiments;
  for (const Scenario& scenario : scenarios) {
    const std::string object = object_of(scenario);
    const bool is_built = std::any_of(experiments.subjects.begin(), experiments.subjects.end(),
                                      [&](const Subject& subject) { return subject.name == object; });
    if (is_built) continue;
    experiments.subjects.push_back(object == "wall" ? make_subject("wall", "wall", 20'000, 0.2)
                                   : object == "crate"
                                       ? make_subject("crate", "box", 1200, 0.1)
                                       : make_subject("scan", study.scan.model, study.scan.faces, study.scan.size));
  }
  for (const Scenario& scenario : scenarios) {
    Experiment experiment{scenario.name, Section::kForces, scenario.digest, study.profiles, study.seeds, {}};
    // Pointers to the subjects stay valid: the vector no longer changes, and moving it does not move its elements.
    const Subject* const subject = experiments.subjects.data() +
                                   (std::find_if(experiments.subjects.begin(), experiments.subjects.end(),
                                                 [&](const Subject& one) { return one.name == object_of(scenario); }) -
                                    experiments.subjects.begin());
    const auto run_by = [&, subject](auto* run) {
      return [scenario, subject, run](const netem::LinkSettings& link, std::uint64_t seed,
                                      const std::atomic<bool>& cancelled) {
        return run(scenario, *subject, link, seed, cancelled);
      };
    };
    experiment.run = run_by(run_scenario);
    switch (scenario.measures) {
      case Measure::kTarget:
        experiment.section = Section::kTarget;
        experiment.run = run_by(press_to_target);
        break;
      case Measure::kLift:
        experiment.section = Section::kLift;
        experiment.run = run_by(lift_together);
        break;
      case Measure::kHandOver:
        experiment.section = Section::kHandOver;
        experiment.run = [scenario](const netem::LinkSettings& link, std::uint64_t seed, const std::atomic<bool>&) {
          return run_hand_over(scenario, link, seed);
        };
        break;
      case Measure::kFirstTouch:
        experiment.section = Section::kFirstTouch;
        break;
      case Measure::kForces:
        if (scenario.tool != client_sim::Tool::kSphere) experiment.section = Section::kTool;
        break;
      case Measure::kNone:
        break;
    }
    experiments.all.push_back(std::move(experiment));
  }
  if (study.collaboration) {
    for (const Method method : {Method::kChannel, Method::kSpring, Method::kNaive, Method::kServer}) {
      experiments.all.push_back({std::string{kCarryPrefix} + kMethodNames[static_cast<int>(method)],
                                 Section::kCollaboration, 0, study.profiles, study.seeds,
                                 [method](const netem::LinkSettings& link, std::uint64_t seed,
                                          const std::atomic<bool>&) { return carry_together(method, link, seed); }});
    }
  }
  if (study.stiffness) {
    Experiment experiment{kStiffnessName, Section::kStiffness, 0, {kBaseline}, 1, {}};
    for (const char* half : {"2.5", "5", "10", "25", "50", "100", "150"})
      experiment.profiles.push_back(std::string{kBaseline} + ":delay=" + half);
    experiment.run = [](const netem::LinkSettings& link, std::uint64_t, const std::atomic<bool>&) {
      return find_stiffness(link);
    };
    experiments.all.push_back(std::move(experiment));
  }
  return experiments;
}

}  // namespace tactus::study
