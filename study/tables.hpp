/// Formats the results of a study as tables, CSV, JSON and a page with plots.
#pragma once

#include <string>
#include <vector>

#include "study/results.hpp"

namespace tactus::study {

/// The conditions of a study.
struct About {
  std::string study, command, machine, build;
  std::vector<std::string> notes;
};
[[nodiscard]] std::string markdown(const About& about, const std::vector<LinkResult>& results);
/// Returns a self-contained page with plots and tables.
[[nodiscard]] std::string html(const About& about, const std::vector<LinkResult>& results);
[[nodiscard]] std::string csv(const std::vector<LinkResult>& results);
[[nodiscard]] std::string json(const About& about, const std::vector<LinkResult>& results);

}  // namespace tactus::study
