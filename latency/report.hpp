/// The results of a latency test as text, JSON and HTML.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "latency/result.hpp"

namespace tactus::latency {

/// The conditions of a test.
struct Subject {
  std::string command;
  std::string machine;  ///< processors and kernel
  std::string build;    ///< version
};
[[nodiscard]] Subject subject_of(int argc, const char* const* argv);

/// One line for each result, and each note once.
void print_table(std::ostream& out, const Subject& subject, const std::vector<Result>& results);

/// All figures, curves included. Throws LatencyError when the file cannot be written.
void write_json(const std::string& file, const Subject& subject, const std::vector<Result>& results);

/// One self-contained page with the table, the distributions and each run over time. Throws LatencyError likewise.
void write_html(const std::string& file, const Subject& subject, const std::vector<Result>& results);

}  // namespace tactus::latency
