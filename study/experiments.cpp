#include "study/experiments.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "study/hand_over.hpp"
#include "study/shared_world.hpp"
#include "study/stiffness.hpp"

namespace tactus::study {
namespace {

using client_sim::ActionKind;
using client_sim::Measure;
using client_sim::Scenario;

constexpr double kDt = 1e-3;  // s

/// The object's copies on links like the slower of the two ways.
WorldSettings world_for(const netem::LinkSettings& link, std::size_t users, std::uint64_t seed) {
  // Where the line's delay comes from in a session: what arrives at all arrives by then, but for a hundredth.
  constexpr double kDeviations = 2.3;
  WorldSettings world;
  world.users = users;
  world.link = link.forth.delay_ms >= link.back.delay_ms ? link.forth : link.back;
  world.playout = (world.link.delay_ms + kDeviations * world.link.jitter_ms) * 1e-3 + kDt;
  world.seed = seed;
  return world;
}

/// The user's first action of that kind. `check` has seen to it that there is one.
const client_sim::Action& action_of(const client_sim::User& user, ActionKind kind) {
  return *std::find_if(user.script.begin(), user.script.end(),
                       [&](const client_sim::Action& action) { return action.kind == kind; });
}

ScenarioRun press_to_target(const Scenario& scenario, const netem::LinkSettings& link, std::uint64_t seed) {
  constexpr std::size_t kSettling = 1000, kKept = 200;  // ms
  const double target = action_of(scenario.users.front(), ActionKind::kHold).force;
  const double seconds = action_of(scenario.users.front(), ActionKind::kHold).seconds;
  const std::vector<std::vector<double>> forces =
      press(world_for(link, scenario.users.size(), seed), scenario.users, scenario.duration);
  const std::size_t end = forces.front().size();
  const auto all = [&](std::size_t ms, auto&& holds) {
    return std::all_of(forces.begin(), forces.end(), [&](const std::vector<double>& user) { return holds(user[ms]); });
  };
  std::size_t begin = 0;
  while (begin < end && !all(begin, [](double force) { return force >= kLeastForce; })) ++begin;
  std::size_t reached = begin;
  for (std::size_t kept = 0; reached < end && kept < kKept; ++reached)
    kept = all(reached, [&](double force) { return std::abs(force - target) <= scenario.within; }) ? kept + 1 : 0;
  double squares = 0, most = 0;
  std::size_t on_target = 0, lost = 0, judged = 0;
  const std::size_t last = std::min(end, begin + static_cast<std::size_t>(seconds / kDt));
  for (std::size_t ms = begin + kSettling; ms < last; ++ms) {
    for (const std::vector<double>& user : forces) {
      const double off = std::abs(user[ms] - target);
      squares += off * off;
      most = std::max(most, off);
      on_target += off <= scenario.within ? 1 : 0;
      lost += user[ms] < kLeastForce ? 1 : 0;
      ++judged;
    }
  }
  const auto count = static_cast<double>(std::max<std::size_t>(judged, 1));
  const auto percent = [&](std::size_t of) { return 100 * static_cast<double>(of) / count; };
  const auto ms_from = [&](std::size_t from, std::size_t to) { return static_cast<double>(to - from); };
  return {{{"both touch after", "ms", ms_from(0, begin)},
           {"on target after", "ms", ms_from(begin, reached)},
           {"on target", "%", percent(on_target)},
           {"off target by, rms", "N", std::sqrt(squares / count)},
           {"off target by, most", "N", most},
           {"contact lost", "%", percent(lost)}},
          {}};
}

ScenarioRun take_turns(const Scenario& scenario, const netem::LinkSettings& link, std::uint64_t seed) {
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
  // A pushed copy that runs away, or hardly moves at all, has no mass to speak of.
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
           {"line", "N/m", found.copies_line}},
          {}};
}

}  // namespace

Experiments experiments_of(const Study& study, const std::vector<Scenario>& scenarios) {
  Experiments experiments;
  for (const Scenario& scenario : scenarios) {
    const std::string object = object_of(scenario);
    const bool is_there = std::any_of(experiments.subjects.begin(), experiments.subjects.end(),
                                      [&](const Subject& subject) { return subject.name == object; });
    if (is_there || object == "box") continue;
    experiments.subjects.push_back(object == "wall"
                                       ? make_subject("wall", "wall", 20'000, 0.2)
                                       : make_subject("scan", study.scan.model, study.scan.faces, study.scan.size));
  }
  for (const Scenario& scenario : scenarios) {
    Experiment experiment{scenario.name, Topic::kForces, scenario.digest, study.profiles, study.seeds, {}};
    switch (scenario.measures) {
      case Measure::kTarget:
        experiment.topic = Topic::kTarget;
        experiment.run = [scenario](const netem::LinkSettings& link, std::uint64_t seed, const std::atomic<bool>&) {
          return press_to_target(scenario, link, seed);
        };
        break;
      case Measure::kHandOver:
        experiment.topic = Topic::kHandOver;
        experiment.run = [scenario](const netem::LinkSettings& link, std::uint64_t seed, const std::atomic<bool>&) {
          return take_turns(scenario, link, seed);
        };
        break;
      case Measure::kFirstTouch:
        experiment.topic = Topic::kFirstTouch;
        [[fallthrough]];
      case Measure::kForces:
      case Measure::kNone: {
        // Subjects do not move any more: what they own stays where it is when the list is handed on.
        const auto subject =
            static_cast<std::size_t>(std::find_if(experiments.subjects.begin(), experiments.subjects.end(),
                                                  [&](const Subject& one) { return one.name == object_of(scenario); }) -
                                     experiments.subjects.begin());
        const Subject* const at = experiments.subjects.data() + subject;
        experiment.run = [scenario, at](const netem::LinkSettings& link, std::uint64_t seed,
                                        const std::atomic<bool>& stop) {
          return run_scenario(scenario, *at, link, seed, stop);
        };
      }
    }
    experiments.all.push_back(std::move(experiment));
  }
  if (study.collaboration) {
    for (const Method method : {Method::kLine, Method::kSpring, Method::kNaive, Method::kServer}) {
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
