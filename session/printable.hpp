/// Finds and replaces control characters, because a text from the network or from a file must neither command the
/// terminal nor begin a line.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace tactus::session {

/// Size in bytes of the control character at an index of a text in UTF-8; 0 if another one is there. The control
/// characters are U+0000 to U+001F, and U+007F to U+009F.
[[nodiscard]] inline std::size_t control_character_size(std::string_view text, std::size_t at) noexcept {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  if (byte(at) < 0x20 || byte(at) == 0x7f) return 1;
  return byte(at) == 0xc2 && at + 1 < text.size() && byte(at + 1) >= 0x80 && byte(at + 1) < 0xa0 ? 2 : 0;
}

[[nodiscard]] inline bool has_control_character(std::string_view text) noexcept {
  for (std::size_t i = 0; i < text.size(); ++i)
    if (control_character_size(text, i) > 0) return true;
  return false;
}

/// Replaces each control character of a text by "?".
[[nodiscard]] inline std::string printable(std::string_view text) {
  std::string result;
  result.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    const std::size_t size = control_character_size(text, i);
    result += size > 0 ? '?' : text[i];
    if (size > 1) i += size - 1;
  }
  return result;
}

}  // namespace tactus::session
