/// Judges the facts of a machine and states remedies.
#pragma once

#include <string>
#include <vector>

#include "tools/doctor/facts.hpp"

namespace tactus::doctor {

enum class Severity {
  kGood,
  kAdvice,  ///< works, but worse than it could
  kFault    ///< does not work, or not with others
};
inline constexpr const char* kSeverityNames[] = {"good", "advice", "fault"};

struct Finding {
  Severity severity = Severity::kGood;
  std::string topic;  ///< one word or two
  std::string found;
  std::string remedy;  ///< remedy, a command if possible; empty when good
};

/// At least one finding per topic, in a fixed order. Pure.
[[nodiscard]] std::vector<Finding> judge(const Facts& facts);

[[nodiscard]] std::string text(const std::vector<Finding>& findings);
[[nodiscard]] std::string json(const std::vector<Finding>& findings);

}  // namespace tactus::doctor
