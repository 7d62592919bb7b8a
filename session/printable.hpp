/// Makes a text from the network or from a file safe to print.
#pragma once

#include <string>

namespace tactus::session {

/// Replaces the control characters of a text by "?", because a text from the network or from a file must neither
/// command the terminal nor begin a line.
[[nodiscard]] inline std::string printable(std::string text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto code = static_cast<unsigned char>(text[i]);
    // The bytes 0xc2 0x80 to 0xc2 0x9f are the control characters U+0080 to U+009F.
    const bool follows_c2 = i > 0 && static_cast<unsigned char>(text[i - 1]) == 0xc2;
    if (code < 0x20 || code == 0x7f || (follows_c2 && code >= 0x80 && code < 0xa0)) text[i] = '?';
  }
  return text;
}

}  // namespace tactus::session
