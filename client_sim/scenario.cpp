#include "client_sim/scenario.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <random>
#include <set>
#include <sstream>

#include "client_sim/yaml.hpp"
#include "session/messages.hpp"

namespace tactus::client_sim {

namespace {

using yaml::joined;
using yaml::KeyPath;
using yaml::Map;
using yaml::shown;

constexpr double kLongest = 86400;  // s
constexpr double kFastest = 0.5;    // m/s: the proxy is tested up to this speed
constexpr double kSlowest = 1e-4;
constexpr double kStrongest = 20;  // N

struct Verb {
  const char* name;
  ActionKind kind;
  std::vector<std::string> keys;
};

const std::vector<Verb>& verbs() {
  static const std::vector<Verb> kVerbs{
      {"approach", ActionKind::kApproach, {"object", "direction", "point", "speed", "until_force"}},
      {"tap", ActionKind::kTap, {"object", "direction", "point", "count", "speed", "force", "depth"}},
      {"follow",
       ActionKind::kFollow,
       {"object", "direction", "point", "speed", "force", "seconds", "pattern", "extent", "lean"}},
      {"lift", ActionKind::kLift, {"object", "direction", "point", "speed", "force", "seconds", "height", "others"}},
      {"grab", ActionKind::kGrab, {"object", "direction", "point", "speed", "until_force"}},
      {"move", ActionKind::kMove, {"by", "speed", "seconds"}},
      {"release", ActionKind::kRelease, {}},
      {"hold", ActionKind::kHold, {"seconds", "force"}},
      {"wait", ActionKind::kWait, {"seconds"}},
      {"retreat", ActionKind::kRetreat, {"speed"}},
  };
  return kVerbs;
}

/// Default values of a lift.
Action lifting(Action action) {
  action.force = 6;
  action.speed = 0.08;
  action.seconds = 2;
  return action;
}

Action parse_action(const KeyPath& key_path, const YAML::Node& node) {
  std::vector<std::string> names;
  for (const Verb& verb : verbs()) names.emplace_back(verb.name);
  const Map outer{key_path, node, names};
  if (!node.IsMap() || node.size() != 1) key_path.fail(node.Mark(), "expected one action of " + joined(names));
  const Verb& verb = *std::find_if(verbs().begin(), verbs().end(), [&](const Verb& v) { return outer.has(v.name); });
  const Map map{outer.key_path(verb.name), outer.child(verb.name), verb.keys};

  Action action;
  action.kind = verb.kind;
  if (verb.kind == ActionKind::kTap) action.speed = 0.2;
  if (verb.kind == ActionKind::kFollow) action.speed = 0.05;
  if (verb.kind == ActionKind::kApproach || verb.kind == ActionKind::kGrab) action.force = 0.3;
  if (verb.kind == ActionKind::kHold) action.force = 0;
  if (verb.kind == ActionKind::kLift) action = lifting(action);
  map.name("object", action.object);
  map.vector("direction", -1e6, 1e6, action.direction);
  if (!(action.direction.norm() > 1e-9)) {
    map.key_path("direction").fail(map.child("direction").Mark(), "found a zero vector, expected a direction");
  }
  action.direction.normalize();
  map.vector("point", 0, 1, action.point);
  map.number("speed", kSlowest, kFastest, action.speed);
  const bool approaches = verb.kind == ActionKind::kApproach || verb.kind == ActionKind::kGrab;
  map.number(approaches ? "until_force" : "force", verb.kind == ActionKind::kHold ? 0 : 0.05, kStrongest, action.force);
  map.number("depth", 0, 0.05, action.depth);
  map.number("seconds", 0, kLongest, action.seconds);
  map.integer("count", 1, 10000, action.count);
  map.number("height", 0.001, 1, action.height);
  if (verb.kind == ActionKind::kMove) (void)map.required("by");
  map.vector("by", -2, 2, action.by);
  map.integer("others", 0, 7, action.others);
  map.number("extent", 1e-4, 100, action.extent);
  map.number("lean", 0, 2, action.lean);
  map.choice("pattern", {"circle", "zigzag", "around"}, action.pattern);
  return action;
}

User parse_user(const KeyPath& key_path, const YAML::Node& node) {
  const Map map{key_path, node, {"name", "hrtc", "radius", "repeat", "remote", "script"}};
  User user;
  (void)map.required("name");
  map.name("name", user.name);
  user.hrtc = "#1";
  map.name("hrtc", user.hrtc);
  map.number("radius", 1e-5, 0.05, user.radius);
  map.flag("repeat", user.repeat);
  map.flag("remote", user.remote);
  const YAML::Node script = map.required("script");
  const KeyPath at = map.key_path("script");
  if (!script.IsSequence() || script.size() == 0)
    at.fail(script.Mark(), "found " + shown(script) + ", expected a list of actions");
  bool aimed = false;
  bool takes_time = false;
  bool holds = false;
  for (std::size_t i = 0; i < script.size(); ++i) {
    const Action action = parse_action(at.at(i), script[i]);
    aimed = aimed || !action.object.empty();
    takes_time = takes_time || action.kind != ActionKind::kRetreat;
    if (!aimed && action.kind != ActionKind::kWait) {
      at.at(i).fail(script[i].Mark(), "names no object, and no action before it does");
    }
    const bool open = action.kind != ActionKind::kMove && action.kind != ActionKind::kRelease;
    if (open && holds && action.kind != ActionKind::kWait) {
      at.at(i).fail(script[i].Mark(), "the hand holds something: expected move, wait or release");
    }
    if (!open && !holds) at.at(i).fail(script[i].Mark(), "the hand holds nothing: expected grab before it");
    holds = action.kind == ActionKind::kGrab || (holds && action.kind != ActionKind::kRelease);
    user.script.push_back(action);
  }
  if (user.repeat && !takes_time) at.fail(script.Mark(), "takes no time, so it cannot repeat");
  return user;
}

bool goes_with(Truth truth, Measure measure) {
  switch (measure) {
    case Measure::kNone:
      return truth == Truth::kNone;
    case Measure::kForces:
    case Measure::kFirstTouch:
      return truth == Truth::kFullMesh || truth == Truth::kAnalytic;
    case Measure::kTarget:
    case Measure::kLift:
      return truth == Truth::kAnalytic;
    case Measure::kHandOver:
      return truth == Truth::kStateMachine;
  }
  return false;
}

}  // namespace

Scenario parse_scenario(const std::string& text, const std::string& source) {
  const KeyPath top{source, ""};
  const YAML::Node root = yaml::load(text, top);
  if (!root.IsMap()) top.fail(root.Mark(), "found " + shown(root) + ", expected a map with name and users");
  const Map map{top, root, {"name", "measures", "truth", "within", "tool", "duration", "seed", "spread", "users"}};
  Scenario scenario;
  scenario.digest = session::id_of(text);
  (void)map.required("name");
  map.name("name", scenario.name);
  map.choice("measures", {"nothing", "forces", "first-touch", "target", "lift", "hand-over"}, scenario.measures);
  if (scenario.measures != Measure::kNone) (void)map.required("truth");
  map.choice("truth", {"none", "full-mesh", "analytic", "state-machine"}, scenario.truth);
  if (!goes_with(scenario.truth, scenario.measures)) {
    map.key_path("truth").fail(map.child("truth").Mark(),
                               "found " + shown(map.child("truth")) + ", which does not go with what it measures");
  }
  map.choice("tool", {"ball", "stylus"}, scenario.tool);
  map.number("within", 0.01, 10, scenario.within);
  map.number("spread", 0, 0.5, scenario.spread);
  map.number("duration", 0.1, kLongest, scenario.duration);
  map.integer("seed", 0, 1e15, scenario.seed);
  const YAML::Node users = map.required("users");
  const KeyPath at = map.key_path("users");
  if (!users.IsSequence() || users.size() == 0)
    at.fail(users.Mark(), "found " + shown(users) + ", expected a list of users");
  std::set<std::string> names;
  for (std::size_t i = 0; i < users.size(); ++i) {
    scenario.users.push_back(parse_user(at.at(i), users[i]));
    if (!names.insert(scenario.users.back().name).second) {
      at.at(i).fail(users[i].Mark(), "name '" + scenario.users.back().name + "' occurs twice");
    }
  }
  return scenario;
}

Scenario varied(Scenario scenario, std::uint64_t seed) {
  std::mt19937_64 random{seed};
  std::uniform_real_distribution<double> share{-scenario.spread, scenario.spread};
  scenario.seed = seed;
  for (User& user : scenario.users)
    for (Action& action : user.script)
      for (double& coordinate : action.point) coordinate = std::clamp(coordinate + share(random), 0.0, 1.0);
  return scenario;
}

Scenario load_scenario(const std::string& name_or_path) {
  std::string names;
  for (const BuiltInScenario& built_in : built_in_scenarios()) {
    if (name_or_path == built_in.name) return parse_scenario(built_in.text, "built-in " + name_or_path);
    names += (names.empty() ? "" : ", ") + std::string{built_in.name};
  }
  std::ifstream file{name_or_path};
  std::ostringstream text;
  if (!file || !(text << file.rdbuf())) {
    throw ScenarioError{"scenario '" + name_or_path + "': neither a built-in one (" + names +
                        ") nor a readable file: " + std::strerror(errno)};
  }
  return parse_scenario(text.str(), name_or_path);
}

std::uint32_t ordinal_of(const std::string& reference) {
  if (reference.size() < 2 || reference.size() > 5 || reference[0] != '#') return 0;
  std::uint32_t ordinal = 0;
  for (std::size_t i = 1; i < reference.size(); ++i) {
    if (reference[i] < '0' || reference[i] > '9') return 0;
    ordinal = ordinal * 10 + static_cast<std::uint32_t>(reference[i] - '0');
  }
  return ordinal;
}

}  // namespace tactus::client_sim
