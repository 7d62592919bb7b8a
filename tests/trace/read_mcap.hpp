/// Returns the output of the MCAP reference reader for a file.
#pragma once

#include <array>
#include <cstdio>
#include <memory>
#include <string>

#ifndef TACTUS_READ_MCAP
#define TACTUS_READ_MCAP ""
#endif

namespace tactus::trace {

/// Returns the reason why read_mcap() is not available, or an empty string if it is available.
inline std::string missing_mcap_reader() {
  return *TACTUS_READ_MCAP != '\0'
             ? ""
             : "no reader of MCAP files: Node.js and the packages of package-lock.json are needed";
}

/// Runs a command and returns its output, error messages included.
inline std::string output_of(const std::string& command) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe{popen((command + " 2>&1").c_str(), "r"), &pclose};
  std::string output;
  std::array<char, 4096> part{};
  for (std::size_t bytes; (bytes = std::fread(part.data(), 1, part.size(), pipe.get())) > 0;)
    output.append(part.data(), bytes);
  return output;
}

/// Runs tests/trace/read_mcap.js with `arguments` and returns its output.
inline std::string read_mcap(const std::string& arguments) { return output_of(TACTUS_READ_MCAP " " + arguments); }

}  // namespace tactus::trace
