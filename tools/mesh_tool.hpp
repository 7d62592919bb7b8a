/// `tactus-mesh`: builds, describes and verifies models, audits contact logs, generates meshes.
#pragma once

#include <iosfwd>

namespace tactus::tools {

struct ToolStreams {
  std::ostream& out;     ///< results
  std::ostream& errors;  ///< messages, and progress
  bool progress;         ///< `errors` is a terminal: show a bar
};

enum ExitCode { kDone = 0, kCheckFailed = 1, kBadInput = 2 };

/// The whole program except its streams. Never throws.
[[nodiscard]] int run_mesh_tool(int argc, const char* const* argv, ToolStreams streams);

}  // namespace tactus::tools
