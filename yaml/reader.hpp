/// Reads YAML strictly: every key must be known, and every value must have the expected type and range.
///
/// Error messages name file, line, column, key, the value found and the value expected. Not realtime.
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

/// Thrown for unusable YAML. The message is `file:line:column: key: found ..., expected ...`.
class YamlError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Returns the content of a file. Throws std::system_error if the file cannot be read.
[[nodiscard]] std::string file_text(const std::filesystem::path& file);

/// A value of a YAML document, with its position for messages.
class Value {
 public:
  /// Parses a document. `source` names it in messages. Throws YamlError if `text` is not YAML.
  [[nodiscard]] static Value parse(const std::string& text, const std::string& source);
  /// Reads and parses a file. Throws YamlError if it cannot be read or is not YAML.
  [[nodiscard]] static Value load(const std::filesystem::path& file);

  /// Throws YamlError with the position of this value and the message `what`.
  [[noreturn]] void fail(const std::string& what) const;
  /// Throws YamlError: "found (this value), expected (`what`)".
  [[noreturn]] void fail_expecting(const std::string& what) const;

  [[nodiscard]] const YAML::Node& node() const { return node_; }
  /// Returns the items of a list. Throws YamlError if this is no list or an empty one; `what` names the items in the
  /// message.
  [[nodiscard]] std::vector<Value> items(const std::string& what) const;

  /// Returns a finite number from `min` to `max`. Throws YamlError if this is not one.
  [[nodiscard]] double number(double min, double max) const;
  /// Returns a text of 1 to `max_bytes` bytes. Throws YamlError if this is not one.
  [[nodiscard]] std::string text(std::size_t max_bytes) const;

 private:
  friend class Map;
  Value(std::string source, std::string path, const YAML::Node& node)
      : source_{std::move(source)}, path_{std::move(path)}, node_{node} {}
  /// The value of a key of this map.
  [[nodiscard]] Value child(const std::string& key) const;
  [[noreturn]] void fail_at(YAML::Mark mark, const std::string& what) const;

  std::string source_;
  std::string path_;  // keys and indices from the root, for messages
  YAML::Node node_;
};

/// A map of which all keys are known. A null value counts as an empty map. If a key is missing, the functions with an
/// argument `value` or `values` leave it unchanged. They throw YamlError if the value has a wrong type or range.
class Map {
 public:
  /// Throws YamlError if `value` is no map, or has a key that is not in `allowed` or a key twice.
  Map(Value value, const std::vector<std::string>& allowed);

  [[nodiscard]] const Value& value() const { return value_; }
  [[nodiscard]] bool has(const char* key) const { return value_.node_.IsMap() && value_.node_[key].IsDefined(); }
  /// The value of a key. The map must have the key.
  [[nodiscard]] Value child(const char* key) const { return value_.child(key); }
  /// Returns the value of a key. Throws YamlError if the key is missing.
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
  /// Reads a list of at least one text.
  void texts(const char* key, std::vector<std::string>& values) const;
  void flag(const char* key, bool& value) const;
  /// Reads one of `names` and sets `value` to the enumerator whose number is the index of the name.
  template <class Enum>
  void choice(const char* key, const std::vector<std::string>& names, Enum& value) const {
    if (has(key)) value = static_cast<Enum>(index_in(key, names));
  }

 private:
  /// Returns the index in `names` of the value of a key. Throws YamlError if it is none of them.
  [[nodiscard]] std::size_t index_in(const char* key, const std::vector<std::string>& names) const;

  Value value_;
};

}  // namespace tactus::yaml
