/// The standard output of a program. A full disk must not lose a report unnoticed.
#pragma once

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>

namespace tactus::realtime {

/// Returns the exit status of a program after a write to standard output failed with `error`, an errno. The end of the
/// program that reads the output, such as `head`, is no failure. It ends a program that does not ignore SIGPIPE.
[[nodiscard]] inline int failed_output_status(const char* program, int error, std::ostream& errors = std::cerr) {
  if (error == EPIPE) return 0;
  errors << program << ": cannot write the output: " << std::strerror(error) << '\n';
  return 1;
}

/// Writes what std::cout and stdout still store. Returns `status`; if part of the output could not be written and
/// `status` is 0, returns `failed_output_status`. Call it once, after all output.
[[nodiscard]] inline int status_after_output(const char* program, int status = 0) {
  errno = 0;
  const bool is_written = std::cout.flush() && std::fflush(stdout) == 0 && std::ferror(stdout) == 0;
  if (is_written) return status;
  const int failed = failed_output_status(program, errno == 0 ? EIO : errno);
  return status == 0 ? failed : status;
}

}  // namespace tactus::realtime
