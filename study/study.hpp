/// A study over links, scenarios and seeds, read from YAML.
///
///     name: quick
///     profiles: [P0, P4, P6]                    # P0 is always included: the baseline of paired differences
///     scenarios: [tap-scan, follow-scan, my.yaml]
///     seeds: 10
///     scan: {model: organ, faces: 200000, size: 0.2}
///     collaboration: true
///     stiffness: true
///
/// docs/how-to/studies.md has the details.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client_sim/scenario.hpp"

namespace tactus::study {

/// The object `scan`.
struct Scan {
  std::string model = "organ";  ///< a file, or a generated shape
  std::uint32_t faces = 200'000;
  double size = 0.2;  ///< m
};

struct Study {
  std::string name = "quick";
  std::vector<std::string> profiles{"P0", "P2", "P4", "P6", "P7", "P8"};
  std::vector<std::string> scenarios{"tap-wall",   "tap-wall-remote", "tap-scan", "follow-scan", "tool-scan",
                                     "cold-start", "target-force",    "lift",     "hand-over"};
  std::uint32_t seeds = 5;
  std::uint64_t first_seed = 1;
  Scan scan;
  bool collaboration = true;  ///< the table of simulation methods for a shared object
  bool stiffness = true;      ///< the table of the largest stable stiffness
};

/// The zero-delay link, with which runs of other links and the same seed are paired.
inline constexpr const char* kBaseline = "P0";

/// Parses `text`; `source` names it in messages. Throws yaml::YamlError.
[[nodiscard]] Study parse_study(const std::string& text, const std::string& source);
[[nodiscard]] Study load_study(const std::string& file);

/// Moves the baseline to the front and loads the scenarios. Throws client_sim::ScenarioError or netem::LinkError for a
/// link or scenario that is missing or that a study cannot run.
[[nodiscard]] std::vector<client_sim::Scenario> check(Study& study);

}  // namespace tactus::study
