/// Encodes samples as a Writer does, for tests that change the bytes.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <vector>

#include "wire/convert.hpp"
#include "wire/library.hpp"

namespace tactus::wire::test {

/// `sample` must be valid and smaller than 4 KB.
template <class Sample>
[[nodiscard]] std::vector<std::uint8_t> encoded(const Sample& sample) {
  typename IdlOf<Sample>::Type converted;
  to_idl(sample, converted);
  typename IdlOf<Sample>::Support type;
  constexpr std::uint32_t kMaxBytes = 4096;
  rtps::SerializedPayload_t payload{kMaxBytes};
  if (!encode(type, converted, payload)) throw std::runtime_error("the sample cannot be encoded");
  return {payload.data, payload.data + payload.length};
}

}  // namespace tactus::wire::test
