/// Writes docs/benchmarks.md from the JSON files that Report writes.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tactus::bench {

/// Returns the content of each .json file in `folder`, sorted by file name. Throws std::runtime_error if `folder` has
/// no such file, or if a file is not JSON.
[[nodiscard]] std::vector<nlohmann::json> read_runs(const std::string& folder);

/// Returns the page in Markdown: command and machine, the rows that fall short, then a table for each run. Throws
/// std::runtime_error if the runs are of several commits, and nlohmann's exceptions if a field is missing.
[[nodiscard]] std::string page(const std::vector<nlohmann::json>& runs);

/// Returns a line of text for each row that falls short.
[[nodiscard]] std::vector<std::string> shortfalls(const std::vector<nlohmann::json>& runs);

}  // namespace tactus::bench
