#include "yaml/reader.hpp"

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <set>
#include <sstream>
#include <system_error>

namespace tactus::yaml {
namespace {

std::string number_text(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

std::string range_text(double min, double max) {
  if (!std::isfinite(min)) return "a number";
  if (!std::isfinite(max)) return "a number of at least " + number_text(min);
  return "a number from " + number_text(min) + " to " + number_text(max);
}

std::string joined(const std::vector<std::string>& names) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
  return all;
}

std::string description(const YAML::Node& node) {
  if (!node.IsDefined()) return "nothing";
  if (node.IsScalar()) return "'" + node.Scalar().substr(0, 60) + "'";
  if (node.IsMap()) return "a map";
  if (node.IsSequence()) return node.size() == 0 ? "an empty list" : "a list";
  return "nothing";
}

}  // namespace

std::string file_text(const std::filesystem::path& file) {
  std::ifstream in{file};
  std::ostringstream text;
  if (in.peek() != std::ifstream::traits_type::eof()) text << in.rdbuf();  // sets failbit if it inserts nothing
  if (!in.is_open() || in.bad() || !text) throw std::system_error{errno, std::generic_category()};
  return text.str();
}

Value Value::parse(const std::string& text, const std::string& source) {
  try {
    return {source, "", YAML::Load(text)};
  } catch (const YAML::Exception& error) {
    Value{source, "", {}}.fail_at(
        error.mark,
        "not YAML: " + error.msg + "; check brackets, quotes and indents in this line and the lines before");
  }
}

Value Value::load(const std::filesystem::path& file) {
  try {
    return parse(file_text(file), file.string());
  } catch (const std::system_error& error) {
    throw YamlError{file.string() + ": cannot be read: " + error.code().message()};
  }
}

void Value::fail_at(YAML::Mark mark, const std::string& what) const {
  if (mark.is_null()) mark = {};
  throw YamlError{source_ + ":" + std::to_string(mark.line + 1) + ":" + std::to_string(mark.column + 1) + ": " +
                  (path_.empty() ? "" : path_ + ": ") + what};
}

void Value::fail(const std::string& what) const { fail_at(node_.Mark(), what); }

void Value::fail_expecting(const std::string& what) const {
  fail("found " + description(node_) + ", expected " + what);
}

Value Value::child(const std::string& key) const {
  return {source_, path_.empty() ? key : path_ + "." + key, node_[key]};
}

std::vector<Value> Value::items(const std::string& what) const {
  if (!node_.IsSequence() || node_.size() == 0) fail_expecting("a list of " + what);
  std::vector<Value> all;
  for (std::size_t i = 0; i < node_.size(); ++i)
    all.push_back({source_, path_ + "[" + std::to_string(i) + "]", node_[i]});
  return all;
}

double Value::number(double min, double max) const {
  double value = 0;
  const bool is_number = node_.IsScalar() && YAML::convert<double>::decode(node_, value) && std::isfinite(value);
  if (!is_number || !(value >= min && value <= max)) fail_expecting(range_text(min, max));
  return value;
}

std::string Value::text(std::size_t max_bytes) const {
  if (!node_.IsScalar() || node_.Scalar().empty() || node_.Scalar().size() > max_bytes)
    fail_expecting("a text of 1 to " + std::to_string(max_bytes) + " bytes");
  return node_.Scalar();
}

Map::Map(Value value, const std::vector<std::string>& allowed) : value_{std::move(value)} {
  const YAML::Node& node = value_.node_;
  if (node.IsNull()) return;
  if (!node.IsMap()) value_.fail_expecting("a map of " + joined(allowed));
  std::set<std::string> seen;
  for (const auto& entry : node) {
    const YAML::Node& key_node = entry.first;
    if (!key_node.IsScalar()) value_.fail_at(key_node.Mark(), "found " + description(key_node) + ", expected a key");
    const std::string& key = key_node.Scalar();
    if (std::find(allowed.begin(), allowed.end(), key) == allowed.end()) {
      value_.fail_at(key_node.Mark(), "unknown key '" + key.substr(0, 60) + "', expected one of " + joined(allowed));
    }
    if (!seen.insert(key).second) value_.fail_at(key_node.Mark(), "key '" + key + "' occurs twice");
  }
}

Value Map::required(const char* key) const {
  if (!has(key)) value_.fail("key '" + std::string{key} + "' is missing");
  return child(key);
}

void Map::number(const char* key, double min, double max, double& value) const {
  if (has(key)) value = child(key).number(min, max);
}

void Map::text(const char* key, std::string& value, std::size_t max_bytes) const {
  if (has(key)) value = child(key).text(max_bytes);
}

void Map::texts(const char* key, std::vector<std::string>& values) const {
  if (!has(key)) return;
  values.clear();
  for (const Value& item : child(key).items("texts")) values.push_back(item.text(65535));
}

void Map::flag(const char* key, bool& value) const {
  if (!has(key)) return;
  const Value found = child(key);
  if (!found.node_.IsScalar() || !YAML::convert<bool>::decode(found.node_, value))
    found.fail_expecting("true or false");
}

std::size_t Map::index_in(const char* key, const std::vector<std::string>& names) const {
  const Value found = child(key);
  const auto at = found.node_.IsScalar() ? std::find(names.begin(), names.end(), found.node_.Scalar()) : names.end();
  if (at == names.end()) found.fail_expecting("one of " + joined(names));
  return static_cast<std::size_t>(at - names.begin());
}

}  // namespace tactus::yaml
