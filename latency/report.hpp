/// The results of a latency test for people and for machines.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "latency/result.hpp"

namespace tactus::latency {

/// What the figures were had on.
struct Subject {
  std::string command;
  std::string machine;  ///< processors and kernel
  std::string build;    ///< version
};
[[nodiscard]] Subject subject_of(int argc, const char* const* argv);

/// One line for each result, and what needs saying once.
void print_table(std::ostream& out, const Subject& subject, const std::vector<Result>& results);

/// All of it, the curves included. Throws LatencyError when the file cannot be written.
void write_json(const std::string& file, const Subject& subject, const std::vector<Result>& results);

/// One page with the table, the distributions and each run over time; needs nothing from elsewhere. Throws as above.
void write_html(const std::string& file, const Subject& subject, const std::vector<Result>& results);

}  // namespace tactus::latency
