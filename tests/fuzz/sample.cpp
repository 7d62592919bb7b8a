/// A sample of any topic, as DDS passes it on: catalogue, demand, roster, grants, claims, and all others. The first byte
/// selects the topic.
#include <vector>

#include "tests/fuzz/target.hpp"
#include "wire/tap.hpp"
#include "wire/topics.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace tactus;
  static const std::vector<const char*> names = [] {
    std::vector<const char*> all;
    wire::topics::for_each([&](const auto& topic) { all.push_back(topic.name); });
    return all;
  }();
  if (size > 0) (void)wire::decode(names[data[0] % names.size()], {data + 1, size - 1});
  return 0;
}
