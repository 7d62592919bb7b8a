#include "study/scenario_run.hpp"

#include <memory>
#include <optional>
#include <set>

#include "haptics/body_touch.hpp"
#include "spm/finest_tree.hpp"
#include "spm/offline/generate.hpp"
#include "study/constants.hpp"
#include "study/full_mesh.hpp"
#include "study/true_hand.hpp"
#include "study/virtual_session.hpp"

namespace tactus::study {
namespace {

using client_sim::Measure;
using spm::Vec3d;

/// Makes the true hands of a scenario, and owns the surface that they touch.
class Truth {
 public:
  Truth(const client_sim::Scenario& scenario, const Subject& subject, const spm::MeshProbe* tool,
        const SessionSettings& settings)
      : scale_{subject.model.summary.metres_per_unit},
        radius_{scenario.users.front().radius},
        tool_{tool},
        settings_{settings} {
    const spm::ModelSummary& summary = subject.model.summary;
    if (tool != nullptr) {
      tree_ = std::make_unique<spm::FinestTree>(subject.model.positions, subject.finest);
    } else if (scenario.truth == client_sim::Truth::kAnalytic) {
      Vec3d half;
      for (int axis = 0; axis < 3; ++axis) half[axis] = scale_ * double{summary.bounds_max[axis]};
      surface_ = std::make_unique<haptics::BoxSurface>(half);
    } else {
      surface_ = std::make_unique<FullMesh>(subject.model.positions, subject.finest,
                                            hrtc_service::Placement{{}, scale_}, radius_ / 2);
    }
  }
  [[nodiscard]] std::unique_ptr<TrueHand> hand() const {
    const haptics::ForceSettings& force = settings_.cycle.force;
    if (tool_ == nullptr) return std::make_unique<TrueSphere>(*surface_, radius_, settings_.material, force);
    return std::make_unique<TrueTool>(*tree_, scale_, *tool_, settings_.material, force, settings_.device_spec());
  }

 private:
  double scale_, radius_;
  const spm::MeshProbe* tool_;
  const SessionSettings& settings_;
  std::unique_ptr<haptics::Surface> surface_;
  std::unique_ptr<const spm::FinestTree> tree_;
};

std::optional<spm::MeshProbe> probe_of(client_sim::Tool tool) {
  if (tool == client_sim::Tool::kSphere) return std::nullopt;
  const spm::offline::TriangleMesh mesh = spm::offline::stylus();
  return spm::MeshProbe{mesh.positions, mesh.faces};
}

}  // namespace

std::string object_of(const client_sim::Scenario& scenario) {
  std::set<std::string> objects;
  for (const client_sim::User& user : scenario.users)
    for (const client_sim::Action& action : user.script)
      if (!action.object.empty()) objects.insert(action.object);
  if (objects.size() != 1) {
    throw client_sim::ScenarioError{"scenario '" + scenario.name + "': its users touch " +
                                    std::to_string(objects.size()) + " objects, expected one for a measurement"};
  }
  return *objects.begin();
}

ScenarioRun run_scenario(const client_sim::Scenario& given, const Subject& subject, const netem::LinkSettings& link,
                         std::uint64_t seed, const std::atomic<bool>& cancelled) {
  const client_sim::Scenario scenario = client_sim::varied(given, seed);
  SessionSettings settings;
  settings.link = link;
  settings.seed = seed;
  const std::optional<spm::MeshProbe> tool = probe_of(scenario.tool);
  settings.cycle.tool = tool ? &*tool : nullptr;
  VirtualSession session{subject, scenario, settings};
  const Truth truth{scenario, subject, settings.cycle.tool, settings};
  const bool is_cold_start = scenario.measures == Measure::kFirstTouch;
  is_cold_start ? session.start_users() : session.settle();

  ScenarioRun run;
  run.hands.resize(scenario.users.size());
  std::vector<std::unique_ptr<TrueHand>> true_hands;
  for (std::size_t user = 0; user < scenario.users.size(); ++user) true_hands.push_back(truth.hand());
  double base = -1, touched = -1, exact = -1;  // s; -1: has not happened
  double kbyte = 0;                            // received until the first exact contact
  for (double time = 0; time < scenario.duration && !session.done(); time += kCycle) {
    if (cancelled) return {};
    session.step();
    if (base < 0 && session.base_shown()) base = time;
    for (std::size_t user = 0; user < run.hands.size(); ++user) {
      if (!session.has_hand(user)) continue;
      const Felt& felt = session.felt(user);
      const haptics::Wrench true_wrench = true_hands[user]->at(felt.device, session.mesh_changed());
      run.hands[user].push_back({felt.device.position, felt.wrench, true_wrench, felt.exact});
      if (touched < 0 && true_wrench.force.norm() >= kMinForce) touched = time;
      if (exact >= 0 || !felt.exact || felt.wrench.force.norm() < kMinForce) continue;
      exact = time;
      kbyte = static_cast<double>(session.bytes_received()) * 1e-3;
    }
  }

  Fidelity fidelity;
  for (const std::vector<Sample>& hand : run.hands) {
    for (const Sample& sample : hand) fidelity.add(sample.position, sample.felt, sample.truth, sample.exact);
    fidelity.start_next_hand();
  }
  if (is_cold_start) {
    // An event that did not happen counts with the whole duration and all bytes.
    if (exact < 0) kbyte = static_cast<double>(session.bytes_received()) * 1e-3;
    const auto ms = [&](double at) { return 1e3 * (at < 0 ? scenario.duration : at); };
    run.figures = {{"time to base mesh", "ms", ms(base)},
                   {"time to touch", "ms", ms(touched)},
                   {"time to exact contact", "ms", ms(exact)},
                   {"received until exact", "kB", kbyte},
                   {"share of records received", "%",
                    100.0 * static_cast<double>(session.records_received()) / subject.model.summary.records}};
  }
  for (Figure& figure : fidelity.figures()) run.figures.push_back(std::move(figure));
  if (tool)
    for (Figure& figure : fidelity.torque_figures()) run.figures.push_back(std::move(figure));
  return run;
}

}  // namespace tactus::study
