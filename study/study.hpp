/// A study: profiles by scenarios by seeds, read from YAML.
///
///     name: quick
///     profiles: [P0, P4, P6]                    # P0 is always there: it is what the others are paired with
///     scenarios: [tap-scan, follow-scan, my.yaml]
///     seeds: 10
///     scan: {model: organ, faces: 200000, size: 0.2}
///     collaboration: true
///     stiffness: true
///
/// docs/how-to/studies.md has the rest.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client_sim/scenario.hpp"

namespace tactus::study {

/// What the object `scan` is.
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
  bool collaboration = true;  ///< the table of ways to simulate a shared object
  bool stiffness = true;      ///< that of the largest stable stiffness
};

/// The zero-delay link, with which runs of other links and the same seed are paired.
inline constexpr const char* kBaseline = "P0";

/// Reads `text`; `source` names it in messages. Throws client_sim::ScenarioError.
[[nodiscard]] Study parse_study(const std::string& text, const std::string& source);
[[nodiscard]] Study load_study(const std::string& file);

/// Brings the baseline to the front. Throws client_sim::ScenarioError or netem::LinkError for a profile or a scenario
/// that is not there, or that a study cannot run.
[[nodiscard]] std::vector<client_sim::Scenario> check(Study& study);

}  // namespace tactus::study
