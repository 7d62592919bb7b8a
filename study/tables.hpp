/// A study's cells as tables and as a page with plots.
///
/// Not realtime.
#pragma once

#include <string>
#include <vector>

#include "study/results.hpp"

namespace tactus::study {

/// Context that a reader needs with the figures.
struct About {
  std::string study, command, machine, build;
  std::vector<std::string> notes;
};
[[nodiscard]] std::string markdown(const About& about, const std::vector<Cell>& cells);
/// Plots and tables for a browser, self-contained.
[[nodiscard]] std::string html(const About& about, const std::vector<Cell>& cells);
[[nodiscard]] std::string csv(const std::vector<Cell>& cells);
[[nodiscard]] std::string json(const About& about, const std::vector<Cell>& cells);

}  // namespace tactus::study
