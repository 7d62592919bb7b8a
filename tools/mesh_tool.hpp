/// The program `tactus-mesh`, which builds, describes and verifies models, audits contact logs and generates meshes.
#pragma once

#include <iosfwd>

namespace tactus::tools {

struct ToolStreams {
  std::ostream& out;     ///< results
  std::ostream& errors;  ///< messages, and progress
  bool progress;         ///< show a progress bar on `errors`; true only if `errors` is a terminal
};

enum ExitCode {
  kDone = 0,
  kCheckFailed = 1,  ///< `verify` or `audit` found a difference, or the output could not be written
  kBadInput = 2
};

/// Runs the program with the given streams and returns its exit status. Never throws.
[[nodiscard]] int run_mesh_tool(int argc, const char* const* argv, ToolStreams streams);

}  // namespace tactus::tools
