/// Writes an audit report as text and as JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "tools/audit.hpp"

namespace tactus::tools {

[[nodiscard]] nlohmann::ordered_json audit_json(const AuditReport& report);
/// Returns lines of at most 100 columns, unless a name is longer than 40 bytes.
[[nodiscard]] std::string audit_text(const AuditReport& report);

}  // namespace tactus::tools
