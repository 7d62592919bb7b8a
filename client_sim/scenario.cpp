#include "client_sim/scenario.hpp"

#include <algorithm>
#include <random>
#include <set>
#include <system_error>

#include "session/messages.hpp"
#include "yaml/reader.hpp"

namespace tactus::client_sim {

namespace {

using yaml::Map;
using yaml::Value;

constexpr double kMaxDuration = 86400;  // s
constexpr double kMaxSpeed = 0.5;       // m/s; the max speed in the tests of the proxy
constexpr double kMinSpeed = 1e-4;      // m/s
constexpr double kMaxForce = 20;        // N

struct ActionSyntax {
  const char* name;
  ActionKind kind;
  std::vector<std::string> keys;
};

const std::vector<ActionSyntax>& action_syntaxes() {
  static const std::vector<ActionSyntax> kSyntaxes{
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
  return kSyntaxes;
}

Action with_lift_defaults(Action action) {
  action.force = 6;
  action.speed = 0.08;
  action.seconds = 2;
  return action;
}

void read_vector(const Map& map, const char* key, double min, double max, Vec3d& value) {
  std::array<double, 3> numbers{value.x(), value.y(), value.z()};
  map.numbers(key, min, max, numbers);
  value = Vec3d{numbers[0], numbers[1], numbers[2]};
}

Action parse_action(const Value& value) {
  std::vector<std::string> names;
  for (const ActionSyntax& syntax : action_syntaxes()) names.emplace_back(syntax.name);
  const Map outer{value, names};
  if (!value.node().IsMap() || value.node().size() != 1) value.fail_expecting("a map with one action");
  const ActionSyntax& syntax = *std::find_if(action_syntaxes().begin(), action_syntaxes().end(),
                                             [&](const ActionSyntax& v) { return outer.has(v.name); });
  const Map map{outer.child(syntax.name), syntax.keys};

  Action action;
  action.kind = syntax.kind;
  if (syntax.kind == ActionKind::kTap) action.speed = 0.2;
  if (syntax.kind == ActionKind::kFollow) action.speed = 0.05;
  if (syntax.kind == ActionKind::kApproach || syntax.kind == ActionKind::kGrab) action.force = 0.3;
  if (syntax.kind == ActionKind::kHold) action.force = 0;
  if (syntax.kind == ActionKind::kLift) action = with_lift_defaults(action);
  map.text("object", action.object, session::kMaxName);
  read_vector(map, "direction", -1e6, 1e6, action.direction);
  if (!(action.direction.norm() > 1e-9)) map.child("direction").fail("found a zero vector, expected a direction");
  action.direction.normalize();
  read_vector(map, "point", 0, 1, action.point);
  map.number("speed", kMinSpeed, kMaxSpeed, action.speed);
  const bool approaches = syntax.kind == ActionKind::kApproach || syntax.kind == ActionKind::kGrab;
  map.number(approaches ? "until_force" : "force", syntax.kind == ActionKind::kHold ? 0 : 0.05, kMaxForce,
             action.force);
  map.number("depth", 0, 0.05, action.depth);
  map.number("seconds", 0, kMaxDuration, action.seconds);
  map.integer("count", 1, 10000, action.count);
  map.number("height", 0.001, 1, action.height);
  if (syntax.kind == ActionKind::kMove) (void)map.required("by");
  read_vector(map, "by", -2, 2, action.displacement);
  map.integer("others", 0, 7, action.min_other_users);
  map.number("extent", 1e-4, 100, action.extent);
  map.number("lean", 0, 2, action.tilt);
  map.choice("pattern", {"circle", "zigzag", "around"}, action.pattern);
  return action;
}

User parse_user(const Value& value) {
  const Map map{value, {"name", "hrtc", "radius", "repeat", "remote", "script"}};
  User user;
  (void)map.required("name");
  map.text("name", user.name, session::kMaxName);
  user.hrtc = "#1";
  map.text("hrtc", user.hrtc, session::kMaxName);
  map.number("radius", 1e-5, 0.05, user.radius);
  map.flag("repeat", user.repeats_script);
  map.flag("remote", user.has_remote_device);
  bool has_object = false;
  bool is_holding = false;
  for (const Value& item : map.required("script").items("actions")) {
    const Action action = parse_action(item);
    has_object = has_object || !action.object.empty();
    if (!has_object && action.kind != ActionKind::kWait)
      item.fail("key 'object' is missing, and no earlier action has one");
    const bool needs_held_object = action.kind == ActionKind::kMove || action.kind == ActionKind::kRelease;
    if (!needs_held_object && is_holding && action.kind != ActionKind::kWait)
      item.fail("the hand holds something: expected move, wait or release");
    if (needs_held_object && !is_holding) item.fail("the hand holds nothing: expected grab before it");
    is_holding = action.kind == ActionKind::kGrab || (is_holding && action.kind != ActionKind::kRelease);
    user.script.push_back(action);
  }
  if (user.repeats_script && is_holding)
    map.child("script").fail("the hand holds something at the end: expected release, because the script repeats");
  return user;
}

bool can_compare(Truth truth, Measure measure) {
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

/// Returns the built-in scenario with this name, or null.
const BuiltInScenario* find_built_in(const std::string& name) {
  for (const BuiltInScenario& built_in : built_in_scenarios())
    if (name == built_in.name) return &built_in;
  return nullptr;
}

std::string built_in_names() {
  std::string names;
  for (const BuiltInScenario& built_in : built_in_scenarios())
    names += (names.empty() ? "" : ", ") + std::string{built_in.name};
  return names;
}

}  // namespace

Scenario parse_scenario(const std::string& text, const std::string& source) {
  const Map map{Value::parse(text, source),
                {"name", "measures", "truth", "within", "tool", "duration", "seed", "spread", "users"}};
  Scenario scenario;
  scenario.digest = session::id_of(text);
  (void)map.required("name");
  map.text("name", scenario.name, session::kMaxName);
  map.choice("measures", {"nothing", "forces", "first-touch", "target", "lift", "hand-over"}, scenario.measures);
  if (scenario.measures != Measure::kNone) (void)map.required("truth");
  map.choice("truth", {"none", "full-mesh", "analytic", "state-machine"}, scenario.truth);
  if (!can_compare(scenario.truth, scenario.measures)) {
    map.child("truth").fail_expecting("a truth with which the scenario's 'measures' can be compared");
  }
  map.choice("tool", {"sphere", "stylus"}, scenario.tool);
  map.number("within", 0.01, 10, scenario.force_tolerance);
  map.number("spread", 0, 0.5, scenario.target_spread);
  map.number("duration", 0.1, kMaxDuration, scenario.duration);
  map.integer("seed", 0, 1e15, scenario.seed);
  std::set<std::string> names;
  for (const Value& item : map.required("users").items("users")) {
    scenario.users.push_back(parse_user(item));
    const std::string& name = scenario.users.back().name;
    if (!names.insert(name).second) item.fail("name '" + name + "' occurs twice");
  }
  return scenario;
}

Scenario varied(Scenario scenario, std::uint64_t seed) {
  std::mt19937_64 random{seed};
  std::uniform_real_distribution<double> share{-scenario.target_spread, scenario.target_spread};
  scenario.seed = seed;
  for (User& user : scenario.users)
    for (Action& action : user.script)
      for (double& coordinate : action.point) coordinate = std::clamp(coordinate + share(random), 0.0, 1.0);
  return scenario;
}

const BuiltInScenario& built_in_scenario(const std::string& name) {
  if (const BuiltInScenario* const found = find_built_in(name)) return *found;
  throw ScenarioError{"scenario '" + name + "': not a built-in one, expected one of " + built_in_names()};
}

Scenario load_scenario(const std::string& name_or_path) {
  if (const BuiltInScenario* const found = find_built_in(name_or_path))
    return parse_scenario(found->text, "built-in " + name_or_path);
  try {
    return parse_scenario(yaml::file_text(name_or_path), name_or_path);
  } catch (const std::system_error& error) {
    throw ScenarioError{"scenario '" + name_or_path + "': neither a built-in one (" + built_in_names() +
                        ") nor a readable file: " + error.code().message()};
  }
}

}  // namespace tactus::client_sim
