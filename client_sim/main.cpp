#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "client_sim/report_page.hpp"
#include "client_sim/sim.hpp"
#include "realtime/process.hpp"
#include "realtime/standard_output.hpp"
#include "session/modes.hpp"
#include "session/printable.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus-sim --session lab --scenario demo
  tactus-sim --session lab --scenario my.yaml --json report.json --html report.html
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
      remote: true          # the device is in this program, not in the HRTC
      repeat: true
      script:
        - tap: {object: "#1", count: 5, speed: 0.1, force: 1}
        - wait: {seconds: 1}

"#n" is the n-th HRTC or static object of the session, in the order of names. Patterns: circle, zigzag, around.
"lean: 0.5" tilts a following hand by up to 0.5 rad.
Actions: approach, follow, tap, hold, lift, retreat, wait, grab; after a grab also move and release.
Exit status: 0 the scenario ran, 1 it stopped early, a user had no probe state or the output could not be written,
2 wrong input or the name is taken.)";

[[noreturn]] void fail_to_write(const std::filesystem::path& file, const std::string& cause) {
  throw std::runtime_error("cannot write the report " + file.string() + ": " + cause);
}

/// Writes a temporary file in the same folder and renames it to `file`, so that no other program reads half a report.
void write_report(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path part = file.string() + ".part";
  std::ofstream out{part};
  out << text;
  out.close();
  std::error_code error{out ? 0 : errno, std::generic_category()};
  if (!error) std::filesystem::rename(part, file, error);
  if (!error) return;
  std::error_code ignored;
  std::filesystem::remove(part, ignored);
  fail_to_write(file, error.message());
}

/// Throws before the session starts if the report cannot be written after it. Leaves no file.
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
  std::filesystem::path json, html;
  double seconds = 0;
  double patience = client_sim::SimSettings{}.patience;
  std::string mode;
  bool list = false;

  CLI::App app{"Simulated users: joins a session, runs a scenario, ends the session and reports.", "tactus-sim"};
  app.footer(kExamples);
  wire::add_address_options(app, address, "participant");
  app.add_option("--scenario", scenario, "A built-in scenario or a YAML file")->capture_default_str();
  app.add_option("--seconds", seconds, "Duration in seconds, instead of the scenario's")
      ->check(wire::finite_range(0.1, 86400.0));
  app.add_option("--patience", patience, "Seconds to wait for HRTCs, objects and probes")
      ->capture_default_str()
      ->check(wire::finite_range(0.1, 86400.0));
  app.add_option("--mode", mode,
                 "Session mode, which sets how probe states are sent: auto, collaborate or large-scale. A list "
                 "USER,USER... after collaborate or large-scale restricts the mode to these users");
  app.add_option("--json", json, "File for the report as JSON");
  app.add_option("--html", html, "File for the report as an HTML page with plots");
  app.add_flag("--list", list, "List the built-in scenarios");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& stop = realtime::stop_signal();
  try {
    if (list) {
      for (const client_sim::BuiltInScenario& built_in : client_sim::built_in_scenarios())
        std::cout << built_in.name << '\n';
      return realtime::status_after_output("tactus-sim");
    }
    // Users at a second HRTC appear as participant NAME.2, and so on.
    constexpr std::size_t kSuffix = 3;
    if (address.participant.size() > session::kMaxName - kSuffix && address.participant.size() <= session::kMaxName)
      throw std::runtime_error("--name has " + std::to_string(address.participant.size()) + " bytes, expected 1 to " +
                               std::to_string(session::kMaxName - kSuffix));
    client_sim::SimOptions options{address, client_sim::load_scenario(scenario), patience, mode};
    if (!mode.empty()) (void)session::parse_mode(mode);
    if (seconds > 0) options.scenario.duration = seconds;
    for (const std::filesystem::path& file : {json, html})
      if (!file.empty()) expect_writable(file);
    client_sim::Sim sim{std::move(options)};
    const client_sim::Report report =
        sim.run(stop, [](const std::string& text) { std::cerr << "tactus-sim: " << session::printable(text) << '\n'; });
    std::cout << client_sim::text(report);
    if (!json.empty()) write_report(json, client_sim::json(report));
    if (!html.empty()) write_report(html, client_sim::html(report));
    const bool are_users_served =
        std::all_of(report.users.begin(), report.users.end(), [](const auto& user) { return user.touch.states > 0; });
    return realtime::status_after_output("tactus-sim", report.stop_reason.empty() && are_users_served ? 0 : 1);
  } catch (const std::exception& error) {
    std::cerr << "tactus-sim: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
