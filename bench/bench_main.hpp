/// The command line and the end of every benchmark.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <stdexcept>
#include <string>

#include "bench/figures.hpp"

namespace tactus::bench {

/// A benchmark's command line: --quick, --json and --help, besides what the benchmark adds.
class App : public CLI::App {
 public:
  /// `name` as in `scripts/bench NAME`; `quick_help`: what --quick shortens. It never loosens a bound.
  App(std::string name, const std::string& purpose, const std::string& quick_help)
      : CLI::App{purpose, "scripts/bench " + name}, bench{std::move(name)} {
    add_flag("--quick", quick, quick_help);
    add_option("--json", json, "write the rows to this file, too");
  }

  std::string bench;
  std::string json;
  bool quick = false;
};

/// What ends a benchmark that was asked to stop.
struct Interrupted : std::runtime_error {
  Interrupted() : std::runtime_error{"interrupted"} {}
};

/// Parses, calls `run`, prints its report and writes it as JSON. The exit status: 0 all bounds hold, 1 a figure falls
/// short, 2 wrong input or an exception, 130 interrupted.
[[nodiscard]] int bench_main(App& app, int argc, char** argv, const std::function<Report()>& run);

}  // namespace tactus::bench
