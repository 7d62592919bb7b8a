/// The configuration of a host, YAML.
#include "host_service/host_config.hpp"

#include "tests/fuzz/target.hpp"
#include "yaml/reader.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const tactus::fuzz::MemoryFile file{{data, size}};
  try {
    (void)tactus::host_service::read_config(file.path());
  } catch (const tactus::yaml::YamlError&) {
  }
  return 0;
}
