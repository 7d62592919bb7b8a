#include "study/scenario_run.hpp"

#include <memory>
#include <set>

#include "haptics/body_touch.hpp"
#include "study/full_mesh.hpp"
#include "study/virtual_session.hpp"

namespace tactus::study {
namespace {

using client_sim::Measure;
using spm::Vec3d;

constexpr double kDt = 1e-3;

std::unique_ptr<const haptics::Surface> true_surface(const client_sim::Scenario& scenario, const Subject& subject) {
  const spm::ModelSummary& summary = subject.model.summary;
  const double scale = summary.metres_per_unit;
  if (scenario.truth == client_sim::Truth::kAnalytic) {
    Vec3d half;
    for (int axis = 0; axis < 3; ++axis) half[axis] = scale * double{summary.bounds_max[axis]};
    return std::make_unique<haptics::BoxSurface>(half);
  }
  return std::make_unique<FullMesh>(subject.model.positions, subject.finest, hrtc_service::Placement{{}, scale},
                                    scenario.users.front().radius / 2);
}

}  // namespace

std::string object_of(const client_sim::Scenario& scenario) {
  std::set<std::string> objects;
  for (const client_sim::User& user : scenario.users)
    for (const client_sim::Action& action : user.script)
      if (!action.object.empty()) objects.insert(action.object);
  if (objects.size() != 1) {
    throw client_sim::ScenarioError{"scenario '" + scenario.name + "': its users touch " +
                                    std::to_string(objects.size()) +
                                    " objects, expected one where something is measured"};
  }
  return *objects.begin();
}

ScenarioRun run_scenario(const client_sim::Scenario& given, const Subject& subject, const netem::LinkSettings& link,
                         std::uint64_t seed, const std::atomic<bool>& stop) {
  const client_sim::Scenario scenario = client_sim::varied(given, seed);
  SessionSettings settings;
  settings.link = link;
  settings.seed = seed;
  VirtualSession session{subject, scenario, settings};
  const std::unique_ptr<const haptics::Surface> surface = true_surface(scenario, subject);
  const bool cold = scenario.measures == Measure::kFirstTouch;
  cold ? session.begin() : session.settle();

  ScenarioRun run;
  run.hands.resize(scenario.users.size());
  std::vector<TrueForce> truths(scenario.users.size(), TrueForce{*surface, scenario.users.front().radius,
                                                                 settings.material, settings.cycle.force});
  double base = -1, touched = -1, exact = -1, kbyte = 0;
  for (double time = 0; time < scenario.duration && !session.done(); time += kDt) {
    if (stop) return {};
    session.step();
    if (base < 0 && session.base_shown()) base = time;
    for (std::size_t user = 0; user < run.hands.size(); ++user) {
      if (!session.is_here(user)) continue;
      const Felt& felt = session.felt(user);
      const Vec3d truth = truths[user].at(felt.device);
      run.hands[user].push_back({felt.device.position, felt.force, truth, felt.exact});
      if (touched < 0 && truth.norm() >= kLeastForce) touched = time;
      if (exact >= 0 || !felt.exact || felt.force.norm() < kLeastForce) continue;
      exact = time;
      kbyte = static_cast<double>(session.bytes_received()) * 1e-3;
    }
  }

  Fidelity fidelity;
  for (const std::vector<Sample>& hand : run.hands) {
    for (const Sample& sample : hand) fidelity.add(sample.place, sample.felt, sample.truth, sample.exact);
    fidelity.let_go();
  }
  if (cold) {
    const double missing = scenario.duration;  // what never came counts as the whole run
    const auto ms = [&](double at) { return 1e3 * (at < 0 ? missing : at); };
    run.figures = {{"base mesh shown after", "ms", ms(base)},
                   {"surface met after", "ms", ms(touched)},
                   {"first exact contact after", "ms", ms(exact)},
                   {"received until then", "kB", kbyte},
                   {"of the model's records, in all", "%",
                    100.0 * static_cast<double>(session.records_received()) / subject.model.summary.records}};
  }
  for (Figure& figure : fidelity.figures()) run.figures.push_back(std::move(figure));
  return run;
}

}  // namespace tactus::study
