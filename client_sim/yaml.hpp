/// Strict reading of YAML maps: every key must be known and every value in its range, and each message names the
/// position in the text.
///
/// Not realtime.
#pragma once

#include <yaml-cpp/yaml.h>

#include <cmath>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::client_sim::yaml {

/// A key in the text of `source`, which must outlive it.
class KeyPath {
 public:
  KeyPath(const std::string& source, std::string key) : source_{source}, key_{std::move(key)} {}
  [[nodiscard]] KeyPath below(const std::string& key) const { return {source_, key_.empty() ? key : key_ + "." + key}; }
  [[nodiscard]] KeyPath at(std::size_t i) const { return {source_, key_ + "[" + std::to_string(i) + "]"}; }

  /// Throws ScenarioError: `source:line:column: key: what`.
  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what) const;

 private:
  const std::string& source_;
  std::string key_;
};

/// Describes a node for messages.
[[nodiscard]] std::string shown(const YAML::Node& node);
[[nodiscard]] std::string joined(const std::vector<std::string>& names);

/// Parses all of `text`. Throws ScenarioError when it is not YAML.
[[nodiscard]] YAML::Node load(const std::string& text, const KeyPath& key_path);

/// A map with known keys only. Each reader leaves `value` unchanged when the key is missing, and throws ScenarioError
/// for a wrong type or value.
class Map {
 public:
  Map(const KeyPath& key_path, const YAML::Node& node, const std::vector<std::string>& allowed);

  [[nodiscard]] bool has(const char* key) const { return node_.IsMap() && node_[key].IsDefined(); }
  [[nodiscard]] YAML::Node child(const char* key) const { return node_[key]; }
  /// Throws when the key is missing.
  [[nodiscard]] YAML::Node required(const char* key) const;
  [[nodiscard]] KeyPath key_path(const char* key) const { return key_path_.below(key); }

  void number(const char* key, double low, double high, double& value) const;
  template <class Integer>
  void integer(const char* key, double low, double high, Integer& value) const {
    if (!has(key)) return;
    double whole = 0;
    number(key, low, high, whole);
    if (whole != std::floor(whole))
      key_path(key).fail(child(key).Mark(), "found " + shown(child(key)) + ", expected a whole number");
    value = static_cast<Integer>(whole);
  }
  /// A name as in a session: 1 to 63 bytes.
  void name(const char* key, std::string& value) const;
  /// A text that is not empty.
  void text(const char* key, std::string& value) const;
  /// A list of at least one such text.
  void texts(const char* key, std::vector<std::string>& values) const;
  void flag(const char* key, bool& value) const;
  void vector(const char* key, double low, double high, spm::Vec3d& value) const;
  /// One of `names`, as an enumerator with its index.
  template <class Enum>
  void choice(const char* key, const std::vector<std::string>& names, Enum& value) const {
    if (has(key)) value = static_cast<Enum>(index_among(key, names));
  }

 private:
  [[nodiscard]] std::size_t index_among(const char* key, const std::vector<std::string>& names) const;

  KeyPath key_path_;
  YAML::Node node_;
};

}  // namespace tactus::client_sim::yaml
