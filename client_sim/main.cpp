#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "client_sim/sim.hpp"

namespace {

std::atomic<bool> stop_asked{false};

void ask_to_stop(int) { stop_asked = true; }

constexpr char kExamples[] = R"(
Examples:
  tactus-sim --session lab --scenario demo
  tactus-sim --session lab --scenario my.yaml --json report.json
  tactus-sim --list

Exit status: 0 the scenario ran, 1 it did not run to its end, 2 wrong input.)";

void write_json(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path part = file.string() + ".part";
  std::ofstream out{part};
  out << text << '\n';
  out.close();
  std::error_code error;
  if (out) std::filesystem::rename(part, file, error);
  if (!out || error) throw std::runtime_error("cannot write the report " + file.string());
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  wire::SessionAddress address;
  address.session = "tactus";
  address.participant = "sim";
  std::string scenario = "demo";
  std::filesystem::path json;
  double seconds = 0;
  bool list = false;

  CLI::App app{"Simulated users: brings them to a session, lets them follow a scenario, ends it and reports.",
               "tactus-sim"};
  app.footer(kExamples);
  app.add_option("--session", address.session, "Session to join")->capture_default_str();
  app.add_option("--name", address.participant, "Name of this participant, unique in the session")
      ->capture_default_str();
  app.add_option("--domain", address.domain, "First of the three DDS domains that the session uses")
      ->capture_default_str();
  app.add_option("--qos", address.qos, "Directory of the QoS profiles")->capture_default_str();
  app.add_option("--scenario", scenario, "A built-in scenario or a YAML file")->capture_default_str();
  app.add_option("--seconds", seconds, "Run for so long instead of what the scenario says")
      ->check(CLI::Range(0.1, 86400.0));
  app.add_option("--json", json, "Write the report here as well");
  app.add_flag("--list", list, "Name the built-in scenarios");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  struct sigaction action {};
  action.sa_handler = ask_to_stop;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  try {
    if (list) {
      for (const client_sim::BuiltInScenario& built_in : client_sim::built_in_scenarios())
        std::cout << built_in.name << '\n';
      return 0;
    }
    client_sim::SimOptions options{address, client_sim::load_scenario(scenario)};
    if (seconds > 0) options.scenario.duration = seconds;
    if (!json.empty()) write_json(json, "{}");  // said now rather than after the session
    client_sim::Sim sim{std::move(options)};
    const client_sim::Report report =
        sim.run(stop_asked, [](const std::string& text) { std::cerr << "tactus-sim: " << text << '\n'; });
    std::cout << client_sim::text(report);
    if (!json.empty()) write_json(json, client_sim::json(report));
    return report.trouble.empty() ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "tactus-sim: " << error.what() << '\n';
    return 2;
  }
}
