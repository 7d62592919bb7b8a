/// The settings of a study over links, scenarios and seeds, read from YAML.
///
///     name: quick
///     profiles: [P0, P4, P6]                    # links; every study also runs P0, the baseline of differences
///     scenarios: [tap-scan, follow-scan, my.yaml]
///     seeds: 10
///     scan: {model: organ, faces: 200000, size: 0.2}
///     collaboration: true
///     stiffness: true
///
/// docs/how-to/studies.md describes each setting.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client_sim/scenario.hpp"

namespace tactus::study {

/// The object that scenarios name `scan`.
struct Scan {
  std::string model = "organ";    ///< a file, or the name of a generated shape
  std::uint32_t faces = 200'000;  ///< of a generated shape
  double size = 0.2;              ///< longest side, m
};

struct Study {
  std::string name = "quick";
  std::vector<std::string> profiles{"P0", "P2", "P4", "P6", "P7", "P8"};  ///< links, as netem::parse_link reads them
  std::vector<std::string> scenarios{"tap-wall",   "tap-wall-remote", "tap-scan", "follow-scan", "tool-scan",
                                     "cold-start", "target-force",    "lift",     "hand-over"};
  std::uint32_t seeds = 5;
  std::uint64_t first_seed = 1;
  Scan scan;
  bool collaboration = true;  ///< whether the study compares simulation methods for a shared object
  bool stiffness = true;      ///< whether the study searches the largest stable stiffness
};

/// The link without delay. A study compares each run with the baseline's run of the same scenario and seed.
inline constexpr const char* kBaseline = "P0";

/// Parses `text`, which error messages call `source`. Throws yaml::YamlError.
[[nodiscard]] Study parse_study(const std::string& text, const std::string& source);
[[nodiscard]] Study load_study(const std::string& file);

/// Makes the baseline the first link of `study`, removes repeated links, and loads the scenarios. Throws
/// netem::LinkError for an unknown link, and client_sim::ScenarioError for a scenario that is missing, that a study
/// cannot run, or that has the name of another experiment.
[[nodiscard]] std::vector<client_sim::Scenario> check(Study& study);

}  // namespace tactus::study
