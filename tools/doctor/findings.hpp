/// What the facts of a machine mean for a session, and what mends it.
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
  std::string mend;  ///< a command where there is one; empty when good
};

/// At least one finding for each topic, in a fixed order. Pure.
[[nodiscard]] std::vector<Finding> judge(const Facts& facts);

[[nodiscard]] std::string text(const std::vector<Finding>& findings);
[[nodiscard]] std::string json(const std::vector<Finding>& findings);

}  // namespace tactus::doctor
