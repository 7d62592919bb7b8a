#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

namespace tactus::tools {

/// Sixteen hexadecimal digits.
[[nodiscard]] inline std::string hex(std::uint64_t value) {
  std::string text(16, '0');
  std::snprintf(text.data(), text.size() + 1, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

}  // namespace tactus::tools
