/// Strict reading of YAML: every key must be known, every value must have the expected type and range, and each message
/// names file, line, column, key, the value found and the value expected.
///
/// Not realtime.
#pragma once

#include <yaml-cpp/yaml.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::yaml {

/// The message is `file:line:column: key: found ..., expected ...`.
class YamlError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A value of a document, with its position.
class Value {
 public:
  /// `source` names the document in messages. Throws YamlError when `text` is not YAML.
  [[nodiscard]] static Value parse(const std::string& text, const std::string& source);
  /// Throws YamlError when the file cannot be read or is not YAML.
  [[nodiscard]] static Value load(const std::filesystem::path& file);

  /// Throws YamlError with the position of this value.
  [[noreturn]] void fail(const std::string& what) const;
  /// Throws YamlError: found this value, expected `what`.
  [[noreturn]] void fail_expecting(const std::string& what) const;

  [[nodiscard]] const YAML::Node& node() const { return node_; }
  /// The items of a list that is not empty; `what` names them in the message.
  [[nodiscard]] std::vector<Value> items(const std::string& what) const;

  [[nodiscard]] double number(double min, double max) const;
  /// At most `max_bytes` long, and not empty.
  [[nodiscard]] std::string text(std::size_t max_bytes) const;

 private:
  friend class Map;
  Value(std::string source, std::string path, YAML::Node node)
      : source_{std::move(source)}, path_{std::move(path)}, node_{std::move(node)} {}
  [[nodiscard]] Value below(const std::string& key) const;
  [[noreturn]] void fail_at(YAML::Mark mark, const std::string& what) const;

  std::string source_;
  std::string path_;
  YAML::Node node_;
};

/// A map with known keys only; nothing after a key counts as an empty map. Each reader leaves `value` unchanged when
/// the key is missing, and throws YamlError for a wrong type or value.
class Map {
 public:
  Map(Value value, const std::vector<std::string>& allowed);

  [[nodiscard]] const Value& value() const { return value_; }
  [[nodiscard]] bool has(const char* key) const { return value_.node_.IsMap() && value_.node_[key].IsDefined(); }
  /// The value of a key that the map has.
  [[nodiscard]] Value child(const char* key) const { return value_.below(key); }
  /// Throws when the key is missing.
  [[nodiscard]] Value required(const char* key) const;

  void number(const char* key, double min, double max, double& value) const;
  template <class Integer>
  void integer(const char* key, double min, double max, Integer& value) const {
    if (!has(key)) return;
    const double whole = child(key).number(min, max);
    if (whole != std::floor(whole)) child(key).fail_expecting("a whole number");
    value = static_cast<Integer>(whole);
  }
  template <std::size_t n>
  void numbers(const char* key, double min, double max, std::array<double, n>& values) const {
    if (!has(key)) return;
    if (!child(key).node().IsSequence() || child(key).node().size() != n)
      child(key).fail_expecting("a list of " + std::to_string(n) + " numbers");
    const std::vector<Value> items = child(key).items("numbers");
    for (std::size_t i = 0; i < n; ++i) values[i] = items[i].number(min, max);
  }
  void text(const char* key, std::string& value, std::size_t max_bytes = 65535) const;
  /// A list of at least one text.
  void texts(const char* key, std::vector<std::string>& values) const;
  void flag(const char* key, bool& value) const;
  /// One of `names`, as an enumerator with its index.
  template <class Enum>
  void choice(const char* key, const std::vector<std::string>& names, Enum& value) const {
    if (has(key)) value = static_cast<Enum>(index_among(key, names));
  }

 private:
  [[nodiscard]] std::size_t index_among(const char* key, const std::vector<std::string>& names) const;

  Value value_;
};

}  // namespace tactus::yaml
