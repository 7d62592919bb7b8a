// tactus-scenario: lists the built-in scenarios and prints one as YAML, as a start for a scenario of one's own.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>

#include "client_sim/scenario.hpp"
#include "realtime/standard_output.hpp"
#include "session/printable.hpp"

namespace {

using namespace tactus;

constexpr char kExamples[] = R"(
Examples:
  tactus-scenario list
  tactus-scenario show touch > mine.yaml
  tactus-sim --session lab --scenario mine.yaml

Exit status: 0 printed, 1 the output could not be written, 2 wrong input.)";

void list() {
  for (const client_sim::BuiltInScenario& built_in : client_sim::built_in_scenarios()) {
    const client_sim::Scenario scenario = client_sim::load_scenario(built_in.name);
    const std::size_t users = scenario.users.size();
    std::printf("%-16s %zu %s, %g s%s\n", built_in.name, users, users == 1 ? "user" : "users", scenario.duration,
                scenario.measures == client_sim::Measure::kNone ? "" : ", for studies");
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::string name;
  CLI::App app{"Prints the built-in scenarios.", "tactus-scenario"};
  app.footer(kExamples);
  app.require_subcommand(1);
  const CLI::App* const all = app.add_subcommand("list", "Print name, users and duration of each built-in scenario");
  app.add_subcommand("show", "Print a built-in scenario as YAML, which tactus-sim reads")
      ->add_option("NAME", name, "The scenario, as 'list' prints it")
      ->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    if (all->parsed())
      list();
    else
      std::cout << client_sim::built_in_scenario(name).text;
    return realtime::status_after_output("tactus-scenario");
  } catch (const std::exception& error) {
    std::cerr << "tactus-scenario: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
