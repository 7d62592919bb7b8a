/// Lists the published vulnerabilities of the DDS library, and the mitigation of each.
#pragma once

#include <string>
#include <vector>

namespace tactus::doctor {

struct Vulnerability {
  const char* ids;           ///< one CVE, or several alike
  int count;                 ///< of CVEs
  const char* impact;        ///< what an attacker can do
  const char* precondition;  ///< what the attacker needs
  const char* mitigation;    ///< what limits the impact in a session of Tactus
};

/// Returns those without a correction in the Debian package of this version of Fast DDS; none for an unknown version.
/// Source: the history of Fast DDS, compared with the corrections in the packages of Debian 12 and 13, November 2026.
[[nodiscard]] std::vector<Vulnerability> vulnerabilities(const std::string& version);

/// Returns a table of them, for a terminal.
[[nodiscard]] std::string text(const std::vector<Vulnerability>& open, const std::string& version);

}  // namespace tactus::doctor
