#pragma once

#include <cerrno>
#include <cstring>
#include <iostream>

namespace tactus::tools {

/// Returns the exit status of a program after a write to standard output failed with `error`, an errno. The end of the
/// program that reads the output, such as `head`, is no failure. It ends a program that does not ignore SIGPIPE.
[[nodiscard]] inline int failed_output_status(const char* program, int error, std::ostream& errors = std::cerr) {
  if (error == EPIPE) return 0;
  errors << program << ": cannot write the output: " << std::strerror(error) << '\n';
  return 1;
}

}  // namespace tactus::tools
