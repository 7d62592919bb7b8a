/// Runs the programs in Python that read the formats of Tactus.
#pragma once

#include <string>
#include <vector>

#include "tests/support/process.hpp"

#ifndef TACTUS_PYTHON
#define TACTUS_PYTHON ""
#endif

namespace tactus::formats {

/// The reason to skip a test that needs Python; empty if Python exists.
[[nodiscard]] inline std::string missing_python() {
  return *TACTUS_PYTHON == '\0' ? "no Python (Debian: python3)" : "";
}

/// The command that runs a program in Python with the modules of examples/reader. -B: it writes no files there.
[[nodiscard]] inline std::vector<std::string> python(const std::string& program, std::vector<std::string> arguments) {
  std::vector<std::string> command{"/usr/bin/env", std::string{"PYTHONPATH="} + TACTUS_READER_FOLDER, TACTUS_PYTHON,
                                   "-B", program};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}
[[nodiscard]] inline std::vector<std::string> reader(const std::string& program, std::vector<std::string> arguments) {
  return python(std::string{TACTUS_READER_FOLDER} + "/" + program, std::move(arguments));
}

}  // namespace tactus::formats
