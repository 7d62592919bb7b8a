#include "study/study.hpp"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "hrtc_service/servo/touch_object.hpp"
#include "netem/profile.hpp"
#include "session/messages.hpp"
#include "study/experiments.hpp"
#include "study/scenario_run.hpp"
#include "study/shared_world.hpp"
#include "yaml/reader.hpp"

namespace tactus::study {

using client_sim::ScenarioError;
using yaml::Map;
using yaml::Value;

namespace {

Study read_study(const Value& value) {
  const Map map{value, {"name", "profiles", "scenarios", "seeds", "first_seed", "scan", "collaboration", "stiffness"}};
  Study study;
  (void)map.required("name");
  map.text("name", study.name, session::kMaxName);
  map.texts("profiles", study.profiles);
  map.texts("scenarios", study.scenarios);
  map.integer("seeds", 1, 10'000, study.seeds);
  map.integer("first_seed", 1, 1e9, study.first_seed);
  map.flag("collaboration", study.collaboration);
  map.flag("stiffness", study.stiffness);
  if (map.has("scan")) {
    const Map scan{map.child("scan"), {"model", "faces", "size"}};
    scan.text("model", study.scan.model);
    scan.integer("faces", 1000, 30e6, study.scan.faces);
    scan.number("size", 0.01, 10, study.scan.size);
  }
  return study;
}

}  // namespace

Study parse_study(const std::string& text, const std::string& source) { return read_study(Value::parse(text, source)); }

Study load_study(const std::string& file) { return read_study(Value::load(file)); }

namespace {

using client_sim::ActionKind;
using client_sim::Measure;
using client_sim::Scenario;

/// Returns whether all actions `lift` have the same height.
bool has_one_height(const Scenario& scenario) {
  std::set<double> heights;
  for (const client_sim::User& user : scenario.users)
    for (const client_sim::Action& action : user.script)
      if (action.kind == ActionKind::kLift) heights.insert(action.height);
  return heights.size() < 2;
}

/// Returns whether all users have the same radius. The HRTC of a run has one radius for all tips.
bool has_one_radius(const Scenario& scenario) {
  return std::all_of(scenario.users.begin(), scenario.users.end(),
                     [&](const client_sim::User& user) { return user.radius == scenario.users.front().radius; });
}

/// Returns the reason why a study cannot run the scenario; empty when it can.
std::string refusal_reason(const Scenario& scenario) {
  if (scenario.measures == Measure::kNone) return "measures nothing; expected 'measures' and 'truth'";
  const std::size_t max = hrtc_service::kMaxProbes;
  if (scenario.users.size() > max)
    return "has " + std::to_string(scenario.users.size()) + " users, expected at most " + std::to_string(max);
  const bool allows_tool = scenario.measures == Measure::kForces && scenario.truth == client_sim::Truth::kFullMesh;
  if (scenario.tool != client_sim::Tool::kSphere && !allows_tool)
    return "has a tool, so it must measure forces and have the truth full-mesh";
  if (!has_one_radius(scenario)) return "has users with different values of 'radius', expected one value";
  const std::string object = object_of(scenario);
  if (scenario.measures == Measure::kTarget || scenario.measures == Measure::kLift ||
      scenario.measures == Measure::kHandOver) {
    if (object != "crate") return "touches '" + object + "', expected crate, the body that users share";
    if (scenario.users.size() < 2) return "has one user, expected two or more";
    const auto all_users_have = [&](ActionKind kind) {
      return std::all_of(scenario.users.begin(), scenario.users.end(), [&](const client_sim::User& user) {
        return std::any_of(user.script.begin(), user.script.end(),
                           [&](const auto& action) { return action.kind == kind; });
      });
    };
    if (scenario.measures == Measure::kLift) {
      if (!all_users_have(ActionKind::kLift)) return "has a user without the action lift";
      return has_one_height(scenario) ? "" : "has actions lift with different values of 'height', expected one value";
    }
    if (!all_users_have(ActionKind::kHold)) return "has a user without the action hold";
    if (scenario.measures == Measure::kHandOver && !all_users_have(ActionKind::kWait))
      return "has a user without the action wait";
    return "";
  }
  if (object != "wall" && object != "scan") return "touches '" + object + "', expected wall or scan";
  if (object != "wall" && scenario.truth == client_sim::Truth::kAnalytic)
    return "has the analytic truth, which forces and first-touch have for the wall only";
  return "";
}

/// Returns the names of the study's experiments without a scenario.
std::vector<std::string> names_without_scenario(const Study& study) {
  std::vector<std::string> names;
  if (study.collaboration)
    for (const char* method : kMethodNames) names.push_back(kCarryPrefix + std::string{method});
  if (study.stiffness) names.emplace_back(kStiffnessName);
  return names;
}

}  // namespace

std::vector<Scenario> check(Study& study) {
  std::vector<std::string> profiles{kBaseline};
  for (const std::string& profile : study.profiles)
    if (std::find(profiles.begin(), profiles.end(), profile) == profiles.end()) profiles.push_back(profile);
  for (const std::string& profile : profiles) (void)netem::parse_link(profile);
  study.profiles = std::move(profiles);
  std::vector<Scenario> scenarios;
  std::map<std::string, std::string> sources;  // of each experiment, by its name
  for (const std::string& name : names_without_scenario(study)) sources[name] = "the program";
  for (const std::string& source : study.scenarios) {
    scenarios.push_back(client_sim::load_scenario(source));
    const std::string& name = scenarios.back().name;
    const std::string reason = refusal_reason(scenarios.back());
    if (!reason.empty()) throw ScenarioError{"scenario '" + name + "': " + reason};
    const auto [other, is_new] = sources.emplace(name, "'" + source + "'");
    if (!is_new) {
      throw ScenarioError{"scenarios: found the name '" + name + "' in '" + source + "' and in " + other->second +
                          ", expected a different 'name:' in each"};
    }
  }
  return scenarios;
}

}  // namespace tactus::study
