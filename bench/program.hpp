/// How the main of a benchmark without processes of its own ends.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

namespace tactus::bench {

/// Parses, calls `run` and gives the exit status: 2 for wrong input and for what went wrong.
template <class Run>
int run_program(CLI::App& app, const char* program, int argc, char** argv, Run&& run) {
  try {
    app.parse(argc, argv);
    return run();
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", program, error.what());
    return 2;
  }
}

}  // namespace tactus::bench
