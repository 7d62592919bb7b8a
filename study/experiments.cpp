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

/// A world whose links are all as slow as the slower direction of `link`.
WorldSettings world_for(const netem::LinkSettings& link, std::size_t users, std::uint64_t seed) {
  // The playout delay as in a session: all but a hundredth of the arriving samples arrive within it.
  constexpr double kDeviations = 2.3;
  WorldSettings world;
  world.users = users;
  world.link = link.forth.delay_ms >= link.back.delay_ms ? link.forth : link.back;
  world.playout = (world.link.delay_ms + kDeviations * world.link.jitter_ms + 1) * 1e-3;  // and a cycle
  world.seed = seed;
  return world;
}

ScenarioRun run_hand_over(const Scenario& scenario, const netem::LinkSettings& link, std::uint64_t seed) {
  std::vector<Toucher> users;
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
  const auto if_finite = [&](double value) { return carried.finite ? value : none; };
  // A copy that runs away, or hardly moves, has no meaningful mass.
  const double ratio = mass.mass / world.mass;
  const bool weighs = std::isfinite(ratio) && std::abs(ratio) > 1e-3 && std::abs(ratio) < 100;
  return {{{"runs without end", "%", carried.finite ? 0.0 : 100.0},
           {"settled after", "s", if_finite(carried.settled)},
           {"copies apart 1 s later", "mm", if_finite(carried.apart * 1e3)},
           {"copies apart, most", "mm", if_finite(carried.apart_moving * 1e3)},
           {"injected", "mJ a minute", if_finite(carried.injected * 1e3 * 60 / kSeconds)},
           {"peak force", "N", if_finite(carried.peak_force)},
           {"apparent mass, of the mass", "", weighs ? ratio : none},
           {"apparent damping", "N s/m", weighs ? mass.damping : none}},
          {}};
}

ScenarioRun find_stiffness(const netem::LinkSettings& link) {
  const Stiffness found = largest_stable((link.forth.delay_ms + link.back.delay_ms) * 1e-3, 9);
  return {{{kRoundTrip, "ms", link.forth.delay_ms + link.back.delay_ms},
           {"wall beyond the network: (b + B) / (T/2 + td)", "N/m", found.wall_bound},
           {"held last", "N/m", found.wall},
           {"passivity controller", "N/m", found.wall_passivity},
           {"two copies: 0.8 x 2 B / (RTT + T)", "N/m", found.copies_bound},
           {"naive", "N/m", found.copies_naive},
           {"set position", "N/m", found.copies_set},
           {"channel", "N/m", found.copies_channel}},
          {}};
}

}  // namespace

Experiments experiments_of(const Study& study, const std::vector<Scenario>& scenarios) {
  Experiments experiments;
  for (const Scenario& scenario : scenarios) {
    const std::string object = object_of(scenario);
    const bool is_there = std::any_of(experiments.subjects.begin(), experiments.subjects.end(),
                                      [&](const Subject& subject) { return subject.name == object; });
    if (is_there) continue;
    experiments.subjects.push_back(object == "wall" ? make_subject("wall", "wall", 20'000, 0.2)
                                   : object == "crate"
                                       ? make_subject("crate", "box", 1200, 0.1)
                                       : make_subject("scan", study.scan.model, study.scan.faces, study.scan.size));
  }
  for (const Scenario& scenario : scenarios) {
    Experiment experiment{scenario.name, Topic::kForces, scenario.digest, study.profiles, study.seeds, {}};
    // The vector of subjects does not change any more, so these pointers stay valid when it is moved.
    const Subject* const subject = experiments.subjects.data() +
                                   (std::find_if(experiments.subjects.begin(), experiments.subjects.end(),
                                                 [&](const Subject& one) { return one.name == object_of(scenario); }) -
                                    experiments.subjects.begin());
    const auto run_by = [&, subject](auto* run) {
      return
          [scenario, subject, run](const netem::LinkSettings& link, std::uint64_t seed, const std::atomic<bool>& stop) {
            return run(scenario, *subject, link, seed, stop);
          };
    };
    experiment.run = run_by(run_scenario);
    switch (scenario.measures) {
      case Measure::kTarget:
        experiment.topic = Topic::kTarget;
        experiment.run = run_by(press_to_target);
        break;
      case Measure::kLift:
        experiment.topic = Topic::kLift;
        experiment.run = run_by(lift_together);
        break;
      case Measure::kHandOver:
        experiment.topic = Topic::kHandOver;
        experiment.run = [scenario](const netem::LinkSettings& link, std::uint64_t seed, const std::atomic<bool>&) {
          return run_hand_over(scenario, link, seed);
        };
        break;
      case Measure::kFirstTouch:
        experiment.topic = Topic::kFirstTouch;
        break;
      case Measure::kForces:
        if (scenario.tool != client_sim::Tool::kSphere) experiment.topic = Topic::kTool;
        break;
      case Measure::kNone:
        break;
    }
    experiments.all.push_back(std::move(experiment));
  }
  if (study.collaboration) {
    for (const Method method : {Method::kChannel, Method::kSpring, Method::kNaive, Method::kServer}) {
      experiments.all.push_back({std::string{"carry, "} + kMethodNames[static_cast<int>(method)], Topic::kCollaboration,
                                 0, study.profiles, study.seeds,
                                 [method](const netem::LinkSettings& link, std::uint64_t seed,
                                          const std::atomic<bool>&) { return carry_together(method, link, seed); }});
    }
  }
  if (study.stiffness) {
    Experiment experiment{"stiffness", Topic::kStiffness, 0, {kBaseline}, 1, {}};
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
