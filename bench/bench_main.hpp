/// How every benchmark's main ends: 2 for wrong input and for what went wrong, told in one line on standard error.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>

namespace tactus::bench {

/// Parses, calls `run` and gives the exit status, which is that of `run` when all went well.
template <class Run>
int bench_main(CLI::App& app, const char* program, int argc, char** argv, Run&& run) {
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
