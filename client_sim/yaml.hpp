/// Maps read from YAML that people write: every key known, every value in its range, and each message with the place in
/// the text that is wrong.
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
class Place {
 public:
  Place(const std::string& source, std::string key) : source_{source}, key_{std::move(key)} {}
  [[nodiscard]] Place below(const std::string& key) const { return {source_, key_.empty() ? key : key_ + "." + key}; }
  [[nodiscard]] Place at(std::size_t i) const { return {source_, key_ + "[" + std::to_string(i) + "]"}; }

  /// Throws ScenarioError: `source:line:column: key: what`.
  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what) const;

 private:
  const std::string& source_;
  std::string key_;
};

/// What stands there, in words.
[[nodiscard]] std::string shown(const YAML::Node& node);
[[nodiscard]] std::string joined(const std::vector<std::string>& names);

/// The whole of `text`. Throws ScenarioError when it is no YAML.
[[nodiscard]] YAML::Node load(const std::string& text, const Place& place);

/// A map all of whose keys are known. Each reader leaves `value` as it is when the key is not there, and throws
/// ScenarioError when what is there is something else.
class Map {
 public:
  Map(const Place& place, const YAML::Node& node, const std::vector<std::string>& known);

  [[nodiscard]] bool has(const char* key) const { return node_.IsMap() && node_[key].IsDefined(); }
  [[nodiscard]] YAML::Node child(const char* key) const { return node_[key]; }
  /// Throws when it is missing.
  [[nodiscard]] YAML::Node required(const char* key) const;
  [[nodiscard]] Place place(const char* key) const { return place_.below(key); }

  void number(const char* key, double low, double high, double& value) const;
  template <class Integer>
  void integer(const char* key, double low, double high, Integer& value) const {
    if (!has(key)) return;
    double whole = 0;
    number(key, low, high, whole);
    if (whole != std::floor(whole))
      place(key).fail(child(key).Mark(), "found " + shown(child(key)) + ", expected a whole number");
    value = static_cast<Integer>(whole);
  }
  /// As a session's names are: 1 to 63 bytes.
  void name(const char* key, std::string& value) const;
  /// Anything but nothing.
  void text(const char* key, std::string& value) const;
  /// A list of at least one such text.
  void texts(const char* key, std::vector<std::string>& values) const;
  void flag(const char* key, bool& value) const;
  void vector(const char* key, double low, double high, spm::Vec3d& value) const;
  /// One of `names`, by its place among them.
  template <class Enum>
  void choice(const char* key, const std::vector<std::string>& names, Enum& value) const {
    if (has(key)) value = static_cast<Enum>(place_among(key, names));
  }

 private:
  [[nodiscard]] std::size_t place_among(const char* key, const std::vector<std::string>& names) const;

  Place place_;
  YAML::Node node_;
};

}  // namespace tactus::client_sim::yaml
