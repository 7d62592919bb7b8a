// Prints docs/benchmarks.md or its shortfalls for `scripts/bench report` and `scripts/bench all`. Writes the row of a
// benchmark that failed.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "bench/figures.hpp"
#include "bench/page.hpp"

int main(int argc, char** argv) {
  using namespace tactus::bench;
  CLI::App app{"Prints docs/benchmarks.md or its shortfalls; writes the row of a benchmark that failed",
               "tactus-bench-page"};
  std::string folder, file, bench, command;
  int status = 0;
  CLI::App* write = app.add_subcommand("write", "prints docs/benchmarks.md");
  CLI::App* list = app.add_subcommand("shortfalls", "prints the rows that fall short; exit status 1 if there is one");
  for (CLI::App* each : {write, list}) each->add_option("folder", folder, "folder of the JSON files")->required();
  CLI::App* failed = app.add_subcommand("failed", "writes the row of a benchmark that ended without rows");
  failed->add_option("file", file, "JSON file to write")->required();
  failed->add_option("bench", bench, "name of the benchmark")->required();
  failed->add_option("command", command, "command of the benchmark")->required();
  failed->add_option("status", status, "exit status of the benchmark")->required();
  app.require_subcommand(1);
  try {
    app.parse(argc, argv);
    if (*write) std::fputs(page(read_runs(folder)).c_str(), stdout);
    if (*list) {
      const std::vector<std::string> lines = shortfalls(read_runs(folder));
      for (const std::string& line : lines) std::printf("falls short: %s\n", line.c_str());
      return lines.empty() ? 0 : 1;
    }
    if (*failed) {
      Report report{{.model = "none: no rows were written", .settings = {}}};
      report.add_at_least("runs that ended with rows", {"runs", 1}, "", 0, 1);
      report.add_value("exit status", {"runs", 1}, "", status);
      (void)report.finish(bench, command, file);
    }
    return 0;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "tactus-bench-page: %s\n", error.what());
    return 2;
  }
}
