#include "client_sim/yaml.hpp"

#include <algorithm>
#include <set>
#include <sstream>

#include "client_sim/scenario.hpp"
#include "session/messages.hpp"

namespace tactus::client_sim::yaml {
namespace {

std::string number_text(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

double parse_number(const KeyPath& key_path, const YAML::Node& node, double low, double high) {
  double value = 0;
  const bool is_number = node.IsScalar() && YAML::convert<double>::decode(node, value);
  if (!is_number || !(value >= low && value <= high)) {
    key_path.fail(node.Mark(),
                  "found " + shown(node) + ", expected a number from " + number_text(low) + " to " + number_text(high));
  }
  return value;
}

std::string parse_text(const KeyPath& key_path, const YAML::Node& node) {
  if (!node.IsScalar() || node.Scalar().empty())
    key_path.fail(node.Mark(), "found " + shown(node) + ", expected a text");
  return node.Scalar();
}

}  // namespace

void KeyPath::fail(const YAML::Mark& mark, const std::string& what) const {
  throw ScenarioError{source_ + ":" + std::to_string(mark.line + 1) + ":" + std::to_string(mark.column + 1) + ": " +
                      (key_.empty() ? "" : key_ + ": ") + what};
}

std::string shown(const YAML::Node& node) {
  if (node.IsScalar()) return "'" + node.Scalar().substr(0, 60) + "'";
  if (node.IsMap()) return "a map";
  return node.IsSequence() ? "a list" : "nothing";
}

std::string joined(const std::vector<std::string>& names) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
  return all;
}

YAML::Node load(const std::string& text, const KeyPath& key_path) {
  try {
    return YAML::Load(text);
  } catch (const YAML::Exception& error) {
    key_path.fail(error.mark.is_null() ? YAML::Mark{} : error.mark, "not YAML: " + error.msg);
  }
}

Map::Map(const KeyPath& key_path, const YAML::Node& node, const std::vector<std::string>& allowed)
    : key_path_{key_path}, node_{node} {
  // `retreat:` with nothing after it is an empty map.
  if (node.IsNull()) return;
  if (!node.IsMap()) key_path.fail(node.Mark(), "found " + shown(node) + ", expected a map of " + joined(allowed));
  std::set<std::string> seen;
  for (const auto& pair : node) {
    if (!pair.first.IsScalar()) key_path.fail(pair.first.Mark(), "found " + shown(pair.first) + ", expected a key");
    const std::string& key = pair.first.Scalar();
    if (std::find(allowed.begin(), allowed.end(), key) == allowed.end()) {
      key_path.fail(pair.first.Mark(), "unknown key '" + key.substr(0, 60) + "', expected one of " + joined(allowed));
    }
    if (!seen.insert(key).second) key_path.fail(pair.first.Mark(), "key '" + key + "' occurs twice");
  }
}

YAML::Node Map::required(const char* key) const {
  if (!has(key)) key_path_.fail(node_.Mark(), "key '" + std::string{key} + "' is missing");
  return node_[key];
}

void Map::number(const char* key, double low, double high, double& value) const {
  if (has(key)) value = parse_number(key_path(key), node_[key], low, high);
}

void Map::name(const char* key, std::string& value) const {
  if (!has(key)) return;
  const YAML::Node node = node_[key];
  if (!node.IsScalar() || node.Scalar().empty() || node.Scalar().size() > session::kMaxName) {
    key_path(key).fail(node.Mark(), "found " + shown(node) + ", expected a name of 1 to " +
                                        std::to_string(session::kMaxName) + " bytes");
  }
  value = node.Scalar();
}

void Map::text(const char* key, std::string& value) const {
  if (has(key)) value = parse_text(key_path(key), node_[key]);
}

void Map::texts(const char* key, std::vector<std::string>& values) const {
  if (!has(key)) return;
  const YAML::Node node = node_[key];
  if (!node.IsSequence() || node.size() == 0)
    key_path(key).fail(node.Mark(), "found " + shown(node) + ", expected a list");
  values.clear();
  for (std::size_t i = 0; i < node.size(); ++i) values.push_back(parse_text(key_path(key).at(i), node[i]));
}

void Map::flag(const char* key, bool& value) const {
  if (!has(key)) return;
  if (!node_[key].IsScalar() || !YAML::convert<bool>::decode(node_[key], value)) {
    key_path(key).fail(node_[key].Mark(), "found " + shown(node_[key]) + ", expected true or false");
  }
}

void Map::vector(const char* key, double low, double high, spm::Vec3d& value) const {
  if (!has(key)) return;
  const YAML::Node node = node_[key];
  if (!node.IsSequence() || node.size() != 3) {
    key_path(key).fail(node.Mark(), "found " + shown(node) + ", expected a list of three numbers");
  }
  for (std::size_t i = 0; i < 3; ++i) {
    value[static_cast<Eigen::Index>(i)] = parse_number(key_path(key).at(i), node[i], low, high);
  }
}

std::size_t Map::index_among(const char* key, const std::vector<std::string>& names) const {
  const YAML::Node node = node_[key];
  const auto found = node.IsScalar() ? std::find(names.begin(), names.end(), node.Scalar()) : names.end();
  if (found == names.end())
    key_path(key).fail(node.Mark(), "found " + shown(node) + ", expected one of " + joined(names));
  return static_cast<std::size_t>(found - names.begin());
}

}  // namespace tactus::client_sim::yaml
