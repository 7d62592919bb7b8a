#include "study/study.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

#include "client_sim/yaml.hpp"
#include "hrtc_service/touch_object.hpp"
#include "netem/profile.hpp"
#include "study/scenario_run.hpp"

namespace tactus::study {

using client_sim::ScenarioError;
using client_sim::yaml::Map;
using client_sim::yaml::Place;

Study parse_study(const std::string& text, const std::string& source) {
  const Place top{source, ""};
  const YAML::Node root = client_sim::yaml::load(text, top);
  if (!root.IsMap()) {
    top.fail(root.Mark(), "found " + client_sim::yaml::shown(root) + ", expected a map with name and scenarios");
  }
  const Map map{top, root, {"name", "profiles", "scenarios", "seeds", "first_seed", "scan"}};
  Study study;
  (void)map.required("name");
  map.name("name", study.name);
  map.texts("profiles", study.profiles);
  map.texts("scenarios", study.scenarios);
  map.integer("seeds", 1, 10'000, study.seeds);
  map.integer("first_seed", 1, 1e9, study.first_seed);
  if (map.has("scan")) {
    const Map scan{map.place("scan"), map.child("scan"), {"model", "faces", "size"}};
    scan.text("model", study.scan.model);
    scan.integer("faces", 1000, 30e6, study.scan.faces);
    scan.number("size", 0.01, 10, study.scan.size);
  }
  return study;
}

Study load_study(const std::string& file) {
  std::ifstream in{file};
  std::ostringstream text;
  if (!in || !(text << in.rdbuf())) throw ScenarioError{"study '" + file + "': " + std::strerror(errno)};
  return parse_study(text.str(), file);
}

std::vector<client_sim::Scenario> check(Study& study) {
  const auto refuse = [](const client_sim::Scenario& scenario, const std::string& what) {
    throw ScenarioError{"scenario '" + scenario.name + "': " + what};
  };
  const auto at = std::find(study.profiles.begin(), study.profiles.end(), kBaseline);
  if (at != study.profiles.end()) study.profiles.erase(at);
  study.profiles.insert(study.profiles.begin(), kBaseline);
  for (const std::string& profile : study.profiles) (void)netem::parse_link(profile);
  std::vector<client_sim::Scenario> scenarios;
  for (const std::string& name : study.scenarios) {
    const client_sim::Scenario scenario = client_sim::load_scenario(name);
    if (scenario.measures == client_sim::Measure::kNone)
      refuse(scenario, "measures nothing; expected 'measures' and 'truth'");
    const std::string object = object_of(scenario);
    if (object != "wall" && object != "scan") refuse(scenario, "touches '" + object + "', expected wall or scan");
    if (object != "wall" && scenario.truth == client_sim::Truth::kAnalytic)
      refuse(scenario, "its truth is analytic, which is known of the wall alone");
    if (scenario.users.size() > hrtc_service::kMaxProbes)
      refuse(scenario, "has " + std::to_string(scenario.users.size()) + " users, expected at most " +
                           std::to_string(hrtc_service::kMaxProbes));
    scenarios.push_back(scenario);
  }
  return scenarios;
}

}  // namespace tactus::study
