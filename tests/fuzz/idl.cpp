/// The IDL text of a recording, and a sample of one of its types. The first line has the name of the type; after the
/// text, a zero byte and the sample follow.
#include <algorithm>
#include <string>

#include "tests/fuzz/target.hpp"
#include "trace/idl_schema.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::uint8_t* const end = data + size;
  const std::uint8_t* const name_end = std::find(data, end, '\n');
  const std::uint8_t* const text_end = std::find(name_end, end, '\0');
  const std::string name{data, name_end};
  const std::span<const std::uint8_t> sample{text_end == end ? end : text_end + 1, end};
  const auto guarded = [](const auto& read) {
    try {
      read();
    } catch (const tactus::trace::SchemaError&) {
    }
  };
  guarded([&] {
    const tactus::trace::IdlSchema schema{{name_end, text_end}};
    const std::size_t columns = schema.columns(name).size();
    guarded([&] {
      if (schema.values(name, sample).size() != columns) std::abort();
    });
    guarded([&] { (void)schema.json(name, sample); });
  });
  return 0;
}
