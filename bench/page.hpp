/// The page of benchmarks, docs/benchmarks.md, from the files that Report writes.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tactus::bench {

/// The files in `folder` in the order of their names. Throws std::runtime_error when there are none, or one is no JSON.
[[nodiscard]] std::vector<nlohmann::json> read_runs(const std::string& folder);

/// Markdown: what was run on which machine, the rows that fall short, then one table for each run. Throws
/// std::runtime_error when the runs are not of one commit, and nlohmann's exceptions when a field is missing.
[[nodiscard]] std::string page(const std::vector<nlohmann::json>& runs);

/// A line of text for each row that falls short.
[[nodiscard]] std::vector<std::string> shortfalls(const std::vector<nlohmann::json>& runs);

}  // namespace tactus::bench
