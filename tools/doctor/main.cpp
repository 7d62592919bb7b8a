// tactus-doctor: checks whether this machine is fit for a session, and states remedies.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <iostream>

#include "realtime/process.hpp"
#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "tools/doctor/findings.hpp"
#include "tools/doctor/vulnerabilities.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"
#include "wire/footprint.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus-doctor
  tactus-doctor --domain 40 --json
  tactus-doctor --discovery-server 10.0.0.5

A fault prevents a session. Without a remedy for advice, a session has more latency or loss. Remedies follow ->.
Exit status: 0 no fault, 1 a fault or the output could not be written, 2 wrong input, 130 interrupted.)";

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  doctor::Settings settings;
  bool as_json = false, lists_vulnerabilities = false;
  CLI::App app{"Checks whether this machine is fit for a session: network, real time, clock, ports, versions.",
               "tactus-doctor"};
  app.footer(kExamples);
  app.add_option("--domain", settings.address.domain, "First of the three DDS domains of the session")
      ->capture_default_str()
      ->check(CLI::Range(wire::kMinDomain, wire::kMaxDomain));
  wire::add_discovery_options(app, settings.address.discovery);
  app.add_option("--qos", settings.address.qos, "Directory of the QoS profiles")->capture_default_str();
  wire::add_keys_option(app, settings.keys, "Folder of a program's keys, to check too");
  app.add_option("--priority", settings.priority, "SCHED_FIFO priority to try")
      ->capture_default_str()
      ->check(CLI::Range(1, 98));
  app.add_option("--seconds", settings.seconds, "Duration of the wake-up measurement")
      ->capture_default_str()
      ->check(wire::finite_range(0.1, 3600.0));
  app.add_flag("--vulnerabilities", lists_vulnerabilities,
               "Only list the published vulnerabilities of the DDS library, and their mitigations");
  app.add_flag("--json", as_json, "Print the findings as JSON");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (lists_vulnerabilities) {
    const std::string version = wire::library_version();
    std::cout << doctor::text(doctor::vulnerabilities(version), version);
    return realtime::status_after_output("tactus-doctor");
  }
  const std::atomic<bool>& cancelled = realtime::stop_signal();
  try {
    const std::vector<doctor::Finding> findings = doctor::judge(doctor::collect_facts(settings, cancelled));
    if (cancelled) return 130;
    std::cout << (as_json ? doctor::json(findings) : doctor::text(findings));
    const bool has_fault = std::any_of(findings.begin(), findings.end(),
                                       [](const doctor::Finding& f) { return f.severity == doctor::Severity::kFault; });
    return realtime::status_after_output("tactus-doctor", has_fault ? 1 : 0);
  } catch (const std::exception& error) {
    std::cerr << "tactus-doctor: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
