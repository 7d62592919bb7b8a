#include "wire/flow.hpp"

#include <yaml-cpp/yaml.h>

#include <initializer_list>
#include <string>

namespace tactus::wire {
namespace {

/// A mapping in the file, with exactly the given keys.
class Section {
 public:
  Section(const std::filesystem::path& file, std::string name, const YAML::Node& node,
          std::initializer_list<const char*> keys)
      : file_{file}, name_{std::move(name)}, node_{node} {
    if (!node_.IsMap()) throw WireError(file_.string() + ": '" + name_ + "' is no mapping; expected one");
    for (const auto& entry : node_) {
      const auto key = entry.first.as<std::string>();
      bool known = false;
      for (const char* k : keys) known = known || key == k;
      if (!known) {
        std::string expected;
        for (const char* k : keys) expected += (expected.empty() ? "" : ", ") + std::string{k};
        throw WireError(file_.string() + ": unknown key '" + key + "' in '" + name_ + "'; expected " + expected);
      }
    }
    for (const char* k : keys) {
      if (!node_[k]) throw WireError(file_.string() + ": '" + name_ + "' lacks the key '" + k + "'");
    }
  }

  [[nodiscard]] YAML::Node operator[](const char* key) const { return node_[key]; }

  [[nodiscard]] std::int32_t number(const char* key, std::int32_t low, std::int32_t high) const {
    std::int32_t value = 0;
    if (!YAML::convert<std::int32_t>::decode(node_[key], value) || value < low || value > high) {
      throw WireError(file_.string() + ": " + name_ + "." + key + " is '" + YAML::Dump(node_[key]) +
                      "'; expected a number from " + std::to_string(low) + " to " + std::to_string(high));
    }
    return value;
  }

 private:
  std::filesystem::path file_;
  std::string name_;
  YAML::Node node_;
};

}  // namespace

Flow read_flow(const std::filesystem::path& file) try {
  const Section top{file, "flow", YAML::LoadFile(file.string()), {"sockets"}};
  const Section sockets{file, "sockets", top["sockets"], {"session", "probe", "bulk"}};
  Flow flow;
  for (const auto& [traffic, name] :
       {std::pair{TrafficClass::kSession, "session"}, std::pair{TrafficClass::kProbe, "probe"},
        std::pair{TrafficClass::kBulk, "bulk"}}) {
    const Section marks{file, std::string{"sockets."} + name, sockets[name], {"tos", "priority"}};
    flow.sockets[static_cast<std::size_t>(traffic)] = {marks.number("tos", 0, 255), marks.number("priority", 0, 6)};
  }
  return flow;
} catch (const YAML::BadFile&) {
  throw WireError(file.string() + ": cannot be read; expected the flow settings of this qos directory");
} catch (const YAML::Exception& e) {
  throw WireError(file.string() + ": " + e.what());
}

}  // namespace tactus::wire
