#include "client_sim/scenario.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <initializer_list>
#include <set>
#include <sstream>
#include <utility>

#include "session/messages.hpp"

namespace tactus::client_sim {

namespace {

/// A place in the text, for messages.
class Place {
 public:
  Place(const std::string& source, std::string key) : source_{source}, key_{std::move(key)} {}
  [[nodiscard]] Place below(const std::string& key) const { return {source_, key_.empty() ? key : key_ + "." + key}; }
  [[nodiscard]] Place at(std::size_t i) const { return {source_, key_ + "[" + std::to_string(i) + "]"}; }

  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what) const {
    throw ScenarioError{source_ + ":" + std::to_string(mark.line + 1) + ":" + std::to_string(mark.column + 1) + ": " +
                        (key_.empty() ? "" : key_ + ": ") + what};
  }

 private:
  const std::string& source_;
  std::string key_;
};

std::string shown(const YAML::Node& node) {
  if (node.IsScalar()) return "'" + node.Scalar().substr(0, 60) + "'";
  if (node.IsMap()) return "a map";
  return node.IsSequence() ? "a list" : "nothing";
}

std::string number_text(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

std::string joined(const std::vector<std::string>& names) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
  return all;
}

/// A map all of whose keys are known.
class Map {
 public:
  Map(const Place& place, const YAML::Node& node, const std::vector<std::string>& known) : place_{place}, node_{node} {
    // `retreat:` with nothing after it is an empty map.
    if (node.IsNull()) return;
    if (!node.IsMap()) place.fail(node.Mark(), "found " + shown(node) + ", expected a map of " + joined(known));
    std::set<std::string> seen;
    for (const auto& pair : node) {
      if (!pair.first.IsScalar()) place.fail(pair.first.Mark(), "found " + shown(pair.first) + ", expected a key");
      const std::string& key = pair.first.Scalar();
      if (std::find(known.begin(), known.end(), key) == known.end()) {
        place.fail(pair.first.Mark(), "unknown key '" + key.substr(0, 60) + "', expected one of " + joined(known));
      }
      if (!seen.insert(key).second) place.fail(pair.first.Mark(), "key '" + key + "' occurs twice");
    }
  }

  [[nodiscard]] bool has(const char* key) const { return node_.IsMap() && node_[key].IsDefined(); }
  [[nodiscard]] YAML::Node child(const char* key) const { return node_[key]; }
  [[nodiscard]] YAML::Node required(const char* key) const {
    if (!has(key)) place_.fail(node_.Mark(), "key '" + std::string{key} + "' is missing");
    return node_[key];
  }
  [[nodiscard]] Place place(const char* key) const { return place_.below(key); }

  void number(const char* key, double low, double high, double& value) const {
    if (!has(key)) return;
    value = parse_number(place(key), node_[key], low, high);
  }

  template <class Integer>
  void integer(const char* key, double low, double high, Integer& value) const {
    if (!has(key)) return;
    const double number = parse_number(place(key), node_[key], low, high);
    if (number != std::floor(number))
      place(key).fail(node_[key].Mark(), "found " + shown(node_[key]) + ", expected a whole number");
    value = static_cast<Integer>(number);
  }

  void name(const char* key, std::string& value) const {
    if (!has(key)) return;
    const YAML::Node node = node_[key];
    if (!node.IsScalar() || node.Scalar().empty() || node.Scalar().size() > session::kMaxName) {
      place(key).fail(node.Mark(), "found " + shown(node) + ", expected a name of 1 to " +
                                       std::to_string(session::kMaxName) + " bytes");
    }
    value = node.Scalar();
  }

  void flag(const char* key, bool& value) const {
    if (!has(key)) return;
    if (!node_[key].IsScalar() || !YAML::convert<bool>::decode(node_[key], value)) {
      place(key).fail(node_[key].Mark(), "found " + shown(node_[key]) + ", expected true or false");
    }
  }

  void vector(const char* key, double low, double high, Vec3d& value) const {
    if (!has(key)) return;
    const YAML::Node node = node_[key];
    if (!node.IsSequence() || node.size() != 3) {
      place(key).fail(node.Mark(), "found " + shown(node) + ", expected a list of three numbers");
    }
    for (std::size_t i = 0; i < 3; ++i) {
      value[static_cast<Eigen::Index>(i)] = parse_number(place(key).at(i), node[i], low, high);
    }
  }

 private:
  static double parse_number(const Place& place, const YAML::Node& node, double low, double high) {
    double value = 0;
    const bool is_number = node.IsScalar() && YAML::convert<double>::decode(node, value);
    if (!is_number || !(value >= low && value <= high)) {
      place.fail(node.Mark(),
                 "found " + shown(node) + ", expected a number from " + number_text(low) + " to " + number_text(high));
    }
    return value;
  }

  Place place_;
  YAML::Node node_;
};

constexpr double kLongest = 86400;  // s
constexpr double kFastest = 0.5;    // m/s: the proxy is tested up to this
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
       {"object", "direction", "point", "speed", "force", "seconds", "pattern", "extent"}},
      {"hold", ActionKind::kHold, {"seconds", "force"}},
      {"wait", ActionKind::kWait, {"seconds"}},
      {"retreat", ActionKind::kRetreat, {"speed"}},
  };
  return kVerbs;
}

Action parse_action(const Place& place, const YAML::Node& node) {
  std::vector<std::string> names;
  for (const Verb& verb : verbs()) names.emplace_back(verb.name);
  const Map outer{place, node, names};
  if (!node.IsMap() || node.size() != 1) place.fail(node.Mark(), "expected one action of " + joined(names));
  const Verb& verb = *std::find_if(verbs().begin(), verbs().end(), [&](const Verb& v) { return outer.has(v.name); });
  const Map map{outer.place(verb.name), outer.child(verb.name), verb.keys};

  Action action;
  action.kind = verb.kind;
  if (verb.kind == ActionKind::kTap) action.speed = 0.2;
  if (verb.kind == ActionKind::kFollow) action.speed = 0.05;
  if (verb.kind == ActionKind::kApproach) action.force = 0.3;
  if (verb.kind == ActionKind::kHold) action.force = 0;
  map.name("object", action.object);
  map.vector("direction", -1e6, 1e6, action.direction);
  if (!(action.direction.norm() > 1e-9)) {
    map.place("direction").fail(map.child("direction").Mark(), "found a zero vector, expected a direction");
  }
  action.direction.normalize();
  map.vector("point", 0, 1, action.point);
  map.number("speed", kSlowest, kFastest, action.speed);
  map.number(verb.kind == ActionKind::kApproach ? "until_force" : "force", verb.kind == ActionKind::kHold ? 0 : 0.05,
             kStrongest, action.force);
  map.number("depth", 0, 0.05, action.depth);
  map.number("seconds", 0, kLongest, action.seconds);
  map.integer("count", 1, 10000, action.count);
  map.number("extent", 1e-4, 100, action.extent);
  if (map.has("pattern")) {
    const YAML::Node pattern = map.child("pattern");
    const std::string text = pattern.IsScalar() ? pattern.Scalar() : "";
    if (text != "circle" && text != "zigzag" && text != "around") {
      map.place("pattern").fail(pattern.Mark(), "found " + shown(pattern) + ", expected circle, zigzag or around");
    }
    action.pattern = text == "circle" ? Pattern::kCircle : text == "zigzag" ? Pattern::kZigzag : Pattern::kAround;
  }
  return action;
}

User parse_user(const Place& place, const YAML::Node& node) {
  const Map map{place, node, {"name", "hrtc", "radius", "repeat", "remote", "script"}};
  User user;
  (void)map.required("name");
  map.name("name", user.name);
  user.hrtc = "#1";
  map.name("hrtc", user.hrtc);
  map.number("radius", 1e-5, 0.05, user.radius);
  map.flag("repeat", user.repeat);
  map.flag("remote", user.remote);
  const YAML::Node script = map.required("script");
  const Place at = map.place("script");
  if (!script.IsSequence() || script.size() == 0)
    at.fail(script.Mark(), "found " + shown(script) + ", expected a list of actions");
  bool aimed = false;
  bool takes_time = false;
  for (std::size_t i = 0; i < script.size(); ++i) {
    const Action action = parse_action(at.at(i), script[i]);
    aimed = aimed || !action.object.empty();
    takes_time = takes_time || action.kind != ActionKind::kRetreat;
    if (!aimed && action.kind != ActionKind::kWait) {
      at.at(i).fail(script[i].Mark(), "names no object, and no action before it does");
    }
    user.script.push_back(action);
  }
  if (user.repeat && !takes_time) at.fail(script.Mark(), "takes no time, so it cannot repeat");
  return user;
}

}  // namespace

Scenario parse_scenario(const std::string& text, const std::string& source) {
  const Place top{source, ""};
  YAML::Node root;
  try {
    root = YAML::Load(text);
  } catch (const YAML::Exception& error) {
    top.fail(error.mark.is_null() ? YAML::Mark{} : error.mark, "not YAML: " + error.msg);
  }
  if (!root.IsMap()) top.fail(root.Mark(), "found " + shown(root) + ", expected a map with name and users");
  const Map map{top, root, {"name", "duration", "seed", "users"}};
  Scenario scenario;
  (void)map.required("name");
  map.name("name", scenario.name);
  map.number("duration", 0.1, kLongest, scenario.duration);
  map.integer("seed", 0, 1e15, scenario.seed);
  const YAML::Node users = map.required("users");
  const Place at = map.place("users");
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

std::uint32_t place_of(const std::string& reference) {
  if (reference.size() < 2 || reference.size() > 5 || reference[0] != '#') return 0;
  std::uint32_t place = 0;
  for (std::size_t i = 1; i < reference.size(); ++i) {
    if (reference[i] < '0' || reference[i] > '9') return 0;
    place = place * 10 + static_cast<std::uint32_t>(reference[i] - '0');
  }
  return place;
}

}  // namespace tactus::client_sim
