/// Writes the results of latency tests as text, JSON and HTML.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "latency/result.hpp"

namespace tactus::latency {

/// The conditions of a run of the program.
struct RunInfo {
  std::string command;
  std::string machine;  ///< processors and kernel
  std::string build;    ///< version
};
[[nodiscard]] RunInfo run_info(int argc, const char* const* argv);

/// Prints one line for each result. Prints a note only once if several results have it.
void print_table(std::ostream& out, const RunInfo& info, const std::vector<Result>& results);

/// Writes all results with their curves. Throws LatencyError when the file cannot be written.
void write_json(const std::string& file, const RunInfo& info, const std::vector<Result>& results);

/// Writes one self-contained page: a table, the distributions, and a plot of each test over time. Throws LatencyError
/// when the file cannot be written.
void write_html(const std::string& file, const RunInfo& info, const std::vector<Result>& results);

}  // namespace tactus::latency
