/// Judges the facts of a machine and proposes remedies.
#pragma once

#include <string>
#include <vector>

#include "tools/doctor/facts.hpp"

namespace tactus::doctor {

enum class Severity {
  kGood,
  kAdvice,  ///< a session works, but with more latency or loss
  kFault    ///< no session works, or none with other machines
};
inline constexpr const char* kSeverityNames[] = {"good", "advice", "fault"};

struct Finding {
  Severity severity = Severity::kGood;
  std::string check;   ///< name of the check, one or two words
  std::string found;   ///< result of the check
  std::string remedy;  ///< a command if possible; empty when good
};

/// Returns at least one finding for each check, in a fixed order. Pure.
[[nodiscard]] std::vector<Finding> judge(const Facts& facts);

[[nodiscard]] std::string text(const std::vector<Finding>& findings);
[[nodiscard]] std::string json(const std::vector<Finding>& findings);

}  // namespace tactus::doctor
