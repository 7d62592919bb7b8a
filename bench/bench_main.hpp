/// The main program of a benchmark: command line, run, report and exit status.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <stdexcept>
#include <string>

#include "bench/figures.hpp"
#include "wire/address/finite_range.hpp"

namespace tactus::bench {

/// Command line with --quick, --json and --help. A benchmark adds its own options.
class App : public CLI::App {
 public:
  /// `name` is the NAME of `scripts/bench NAME`. `quick_help` describes the run with --quick, which may omit bounds but
  /// never loosens one.
  App(std::string name, const std::string& purpose, const std::string& quick_help)
      : CLI::App{purpose, "scripts/bench " + name}, bench{std::move(name)} {
    add_flag("--quick", quick, quick_help);
    add_option("--json", json, "also write the rows to this file, as JSON");
  }

  std::string bench;
  std::string json;
  bool quick = false;
};

/// Thrown by a benchmark that a signal interrupts.
struct Interrupted : std::runtime_error {
  Interrupted() : std::runtime_error{"interrupted"} {}
};

/// Parses the command line, calls `run`, and prints and writes its report. Returns the exit status: 0 if all bounds
/// hold, 1 if a row falls short or there is none, 2 after wrong input or an exception, 130 after Interrupted.
[[nodiscard]] int bench_main(App& app, int argc, char** argv, const std::function<Report()>& run);

}  // namespace tactus::bench
