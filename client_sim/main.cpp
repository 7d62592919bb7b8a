#include <CLI/CLI.hpp>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "client_sim/sim.hpp"
#include "session/modes.hpp"
#include "wire/command_line.hpp"
#include "wire/process.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus-sim --session lab --scenario demo
  tactus-sim --session lab --scenario my.yaml --json report.json
  tactus-sim --list

my.yaml:
  name: two fingers
  duration: 20
  users:
    - name: ann
      hrtc: desk1
      script:
        - approach: {object: organ, direction: [0, 0, 1], speed: 0.1, until_force: 0.5}
        - follow: {speed: 0.05, force: 1, seconds: 8, pattern: circle}
        - retreat: {}
    - name: bob
      hrtc: "#2"
      remote: true          # holds a device here, not in the HRTC
      repeat: true
      script:
        - tap: {object: "#1", count: 5, speed: 0.1, force: 1}
        - wait: {seconds: 1}

"#n" is the n-th there, by name. Patterns: circle, zigzag, around; lean: 0.5 has the hand lean and turn as it follows.
Actions: approach, follow, tap, hold, lift, retreat, wait;
grab, and then move, wait, release.
Exit status: 0 the scenario ran, 1 it did not run to its end, 2 wrong input or a name that is taken.)";

[[noreturn]] void fail_to_write(const std::filesystem::path& file, const std::string& cause) {
  throw std::runtime_error("cannot write the report " + file.string() + ": " + cause);
}

/// Beside `file`, then renamed: a reader never finds half a report.
void write_json(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path part = file.string() + ".part";
  std::ofstream out{part};
  out << text << '\n';
  out.close();
  std::error_code error{out ? 0 : errno, std::generic_category()};
  if (!error) std::filesystem::rename(part, file, error);
  if (!error) return;
  std::error_code ignored;
  std::filesystem::remove(part, ignored);
  fail_to_write(file, error.message());
}

/// Leaves nothing: what is wrong with the place of the report is said now rather than after the session.
void expect_writable(const std::filesystem::path& file) {
  if (std::filesystem::is_directory(file)) fail_to_write(file, "found a directory, expected a file");
  const std::filesystem::path part = file.string() + ".part";
  if (!std::ofstream{part}) fail_to_write(file, std::strerror(errno));
  std::filesystem::remove(part);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  wire::SessionAddress address;
  address.only_reads_bulk = true;
  address.session = "tactus";
  address.participant = "sim";
  std::string scenario = "demo";
  std::filesystem::path json;
  double seconds = 0;
  double patience = client_sim::SimSettings{}.patience;
  std::string mode;
  bool list = false;

  CLI::App app{"Simulated users: brings them to a session, lets them follow a scenario, ends it and reports.",
               "tactus-sim"};
  app.footer(kExamples);
  wire::add_address_options(app, address, "participant");
  app.add_option("--scenario", scenario, "A built-in scenario or a YAML file")->capture_default_str();
  app.add_option("--seconds", seconds, "Run for so long instead of what the scenario says")
      ->check(CLI::Range(0.1, 86400.0));
  app.add_option("--patience", patience,
                 "Give up when controllers, objects and slots are not there within so many seconds")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 86400.0));
  app.add_option("--mode", mode,
                 "Tell the session how probe states travel: auto, or collaborate or large-scale, for everyone or "
                 "followed by USER,USER...");
  app.add_option("--json", json, "Write the report here as well");
  app.add_flag("--list", list, "Name the built-in scenarios");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& stop = wire::stop_signal();
  try {
    if (list) {
      for (const client_sim::BuiltInScenario& built_in : client_sim::built_in_scenarios())
        std::cout << built_in.name << '\n';
      return 0;
    }
    // Users at a second HRTC make it appear as NAME.2, and so on.
    constexpr std::size_t kSuffix = 3;
    if (address.participant.size() > session::kMaxName - kSuffix && address.participant.size() <= session::kMaxName)
      throw std::runtime_error("--name has " + std::to_string(address.participant.size()) + " bytes, expected 1 to " +
                               std::to_string(session::kMaxName - kSuffix));
    client_sim::SimOptions options{address, client_sim::load_scenario(scenario), patience, mode};
    if (!mode.empty()) (void)session::parse_mode(mode);
    if (seconds > 0) options.scenario.duration = seconds;
    if (!json.empty()) expect_writable(json);
    client_sim::Sim sim{std::move(options)};
    const client_sim::Report report =
        sim.run(stop, [](const std::string& text) { std::cerr << "tactus-sim: " << text << '\n'; });
    std::cout << client_sim::text(report);
    if (!json.empty()) write_json(json, client_sim::json(report));
    return report.trouble.empty() ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "tactus-sim: " << error.what() << '\n';
    return 2;
  }
}
