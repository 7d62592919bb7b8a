#pragma once

#include <cerrno>
#include <cstring>
#include <iostream>
#include <string>

namespace tactus::tools {

/// Replaces the control characters of a text by "?", because a text from the network must not command the terminal.
[[nodiscard]] inline std::string printable(std::string text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto code = static_cast<unsigned char>(text[i]);
    // The bytes 0xc2 0x80 to 0xc2 0x9f are the control characters U+0080 to U+009F.
    const bool follows_c2 = i > 0 && static_cast<unsigned char>(text[i - 1]) == 0xc2;
    if (code < 0x20 || code == 0x7f || (follows_c2 && code >= 0x80 && code < 0xa0)) text[i] = '?';
  }
  return text;
}

/// Returns the exit status of a program after a write to standard output failed with `error`, an errno. The end of the
/// program that reads the output, such as `head`, is no failure. It ends a program that does not ignore SIGPIPE.
[[nodiscard]] inline int failed_output_status(const char* program, int error, std::ostream& errors = std::cerr) {
  if (error == EPIPE) return 0;
  errors << program << ": cannot write the output: " << std::strerror(error) << '\n';
  return 1;
}

}  // namespace tactus::tools
