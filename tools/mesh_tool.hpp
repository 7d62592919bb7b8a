/// `tactus-mesh`: builds models, tells what is in them, checks them and logs of touching them, generates meshes.
#pragma once

#include <iosfwd>

namespace tactus::tools {

struct ToolStreams {
  std::ostream& out;     ///< what was asked for
  std::ostream& errors;  ///< messages, and progress
  bool progress;         ///< `errors` is a terminal: show a bar
};

enum ExitCode { kDone = 0, kCheckFailed = 1, kBadInput = 2 };

/// All of the program but its streams. Never throws.
[[nodiscard]] int run_mesh_tool(int argc, const char* const* argv, ToolStreams streams);

}  // namespace tactus::tools
