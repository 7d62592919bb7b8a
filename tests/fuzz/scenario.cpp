/// A scenario, YAML.
#include "client_sim/scenario.hpp"

#include <string>

#include "tests/fuzz/target.hpp"
#include "yaml/reader.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    (void)tactus::client_sim::parse_scenario(std::string{reinterpret_cast<const char*>(data), size}, "fuzz.yaml");
  } catch (const tactus::yaml::YamlError&) {
  }
  return 0;
}
