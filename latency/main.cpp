// tactus-latency: the QoS latency tests.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <map>
#include <optional>

#include "latency/report.hpp"
#include "latency/run.hpp"
#include "netem/profile.hpp"
#include "realtime/process.hpp"
#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "wire/address/command_line.hpp"
#include "wire/participants.hpp"

namespace tactus::latency {
namespace {

constexpr int kWrongInput = 2;
constexpr int kInterrupted = 130;
constexpr std::uint16_t kPort = 7390;

constexpr char kExamples[] = R"(
Examples:
  tactus-latency run
  tactus-latency run --transport raw-udp,udp --rate 100,1000 --html latency.html
  tactus-latency run --profile tactus,plain --load 0,50 --link veth,P4 --seconds 20 --json latency.json
  tactus-latency run --topic records --payload 64,1200 --readers 1,4

On two machines:
  tactus-latency serve --listen 0.0.0.0     (on one)
  tactus-latency run --to OTHER-HOST        (on the other)

Options from --transport to --link accept several values, separated by commas. Every combination of values is a test.
Links need root.

Exit status: 0 done, 1 the output could not be written, 2 wrong input or missing support of machine or network,
130 interrupted.)";

template <class Enum, std::size_t n>
CLI::Option* add_axis(CLI::App& app, const std::string& name, std::vector<Enum>& values,
                      const std::array<const char*, n>& names, const std::string& what) {
  std::map<std::string, Enum> known;
  std::string list;
  for (std::size_t i = 0; i < n; ++i) {
    known[names[i]] = static_cast<Enum>(i);
    list += std::string{i == 0 ? "" : ","} + names[i];
  }
  return app.add_option(name, values, what)
      ->delimiter(',')
      ->transform(CLI::CheckedTransformer(known).description("{" + list + "}"))
      ->default_str(names[static_cast<std::size_t>(values.front())]);
}

struct Options {
  Grid grid;
  RunSettings settings;
  std::vector<std::string> loads{"0"};
  std::string to, json, html;
  std::string listen = "127.0.0.1";
  std::uint16_t port = kPort;
  int control = -1;
};

void add_run(CLI::App& app, Options& o) {
  add_axis(app, "--transport", o.grid.transports, kTransportNames,
           "Transport of the samples; raw-udp is the reference");
  add_axis(app, "--profile", o.grid.profiles, kProfileNames,
           "QoS: qos/, the library's defaults, the defaults with one participant, or tuned by hand");
  add_axis(app, "--topic", o.grid.topics, kTopicNames, "Topic of the samples");
  app.add_option("--payload", o.grid.payloads, "Bytes of a record or of a raw datagram; a probe state has 236")
      ->delimiter(',');
  app.add_option("--rate", o.grid.rates, "Pings per second")->delimiter(',')->default_str("1000");
  add_axis(app, "--coding", o.grid.codings, kCodingNames,
           "Pings to send: all, or those that pass the deadband coding of a simulated hand");
  app.add_option("--readers", o.grid.readers, "Number of readers; each echoes every ping")
      ->delimiter(',')
      ->default_str("1");
  app.add_option("--load", o.loads, "Mbit/s of mesh records during the pings, or max")
      ->delimiter(',')
      ->default_str("0");
  app.add_option("--link", o.grid.links, "Link to emulate between the two sides: none, or one of `tactus-link list`")
      ->delimiter(',')
      ->default_str("none");
  app.add_option("--seconds", o.grid.seconds, "Duration of each test")->capture_default_str();
  app.add_option("--repeat", o.grid.repetitions, "Number of runs of the list of all tests")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  app.add_option("--priority", o.settings.side.priority, "SCHED_FIFO priority of sender and receivers; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0, 98));
  app.add_option("--domain", o.settings.side.domain, "First of three DDS domains")->capture_default_str();
  app.add_option("--seed", o.settings.link_seed, "Seed of emulated links")->capture_default_str();
  app.add_option("--to", o.to, "Machine that runs `tactus-latency serve`; default: both sides run on this machine");
  app.add_option("--port", o.port, "TCP port of `tactus-latency serve`")->capture_default_str();
  app.add_option("--json", o.json, "File for all results");
  app.add_option("--html", o.html, "File for a page with plots");
}

void add_serve(CLI::App& app, Options& o) {
  app.add_option("--listen", o.listen,
                 "IPv4 address to listen on; 0.0.0.0: all. Everyone who reaches it can start tests")
      ->capture_default_str();
  app.add_option("--port", o.port, "TCP port to listen on; 0: a free port")->capture_default_str();
  app.add_option("--priority", o.settings.side.priority, "Maximum SCHED_FIFO priority of receivers; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0, 98));
  app.add_option("--control", o.control, "Open socket to use instead of a port")->group("");
}

std::vector<double> parse_loads(const std::vector<std::string>& texts) {
  std::vector<double> loads;
  for (const std::string& text : texts) {
    double value = kUnpaced;
    if (text != "max" && (!CLI::detail::lexical_cast(text, value) || value < 0))
      throw LatencyError("load is '" + text + "'; expected Mbit/s, at least 0, or max");
    loads.push_back(value);
  }
  return loads;
}

int run(Options& o, const RunInfo& info, const std::atomic<bool>& cancelled) {
  o.grid.loads = parse_loads(o.loads);
  const std::vector<TestCase> tests = o.grid.tests();
  for (const TestCase& test : tests)
    if (test.link != "none") (void)netem::parse_link(test.link);  // throws before the first test runs
  std::optional<ControlConnection> control;
  if (!o.to.empty()) {
    for (const TestCase& test : tests)
      if (test.link != "none")
        throw LatencyError("link is '" + test.link + "'; expected none with --to, where the real network is the link");
    control.emplace(connect_to(o.to, o.port), cancelled);
    o.settings.side.echo_address = o.to;
  }
  std::vector<Result> results;
  int status = 0;
  for (const TestCase& test : tests) {
    std::cerr << "[" << results.size() + 1 << "/" << tests.size() << "] " << describe(test) << '\n';
    try {
      results.push_back(control ? run_with_server(test, *control, o.settings.side, cancelled)
                                : run_locally(test, o.settings, cancelled));
    } catch (const LatencyError& error) {
      if (!cancelled) throw;
      std::cerr << "tactus-latency: interrupted\n";
      status = kInterrupted;
      break;
    }
  }
  if (results.empty()) return status;
  print_table(std::cout, info, results);
  if (!o.json.empty()) write_json(o.json, info, results);
  if (!o.html.empty()) write_html(o.html, info, results);
  return status;
}

int serve_all(const Options& o, const std::atomic<bool>& cancelled) {
  if (o.control >= 0) {
    ControlConnection control{o.control, cancelled};
    try {
      serve(control, o.settings.side, cancelled);
    } catch (const LatencyError&) {  // sent to the other side, which prints it
      if (!cancelled) return kWrongInput;
    }
    return 0;
  }
  const int listener = listen_at(o.listen, o.port);
  std::cerr << "listening on port " << port_of(listener) << "; the other side: tactus-latency run --to HOST\n";
  for (int socket; (socket = accept_from(listener, cancelled)) >= 0;) {
    std::cerr << "a pinger has connected\n";
    ControlConnection control{socket, cancelled};
    try {
      serve(control, o.settings.side, cancelled);
      std::cerr << "the pinger has finished\n";
    } catch (const std::exception& error) {  // the next pinger may succeed
      if (!cancelled) std::cerr << "tactus-latency: " << tactus::session::printable(error.what()) << '\n';
    }
  }
  ::close(listener);
  return 0;
}

}  // namespace
}  // namespace tactus::latency

int main(int argc, char** argv) {
  using namespace tactus::latency;
  Options options;
  options.settings.side.qos = tactus::wire::default_qos_directory();
  CLI::App app{
      "QoS latency tests: half round trip, age, jitter and loss of probe states and records, compared with raw UDP.",
      "tactus-latency"};
  app.footer(kExamples);
  app.require_subcommand(1);
  CLI::App* const run_command = app.add_subcommand("run", "Run latency tests");
  CLI::App* const serve_command =
      app.add_subcommand("serve", "Echo the pings of `run --to` from other machines until Ctrl-C");
  add_run(*run_command, options);
  add_serve(*serve_command, options);
  for (CLI::App* const command : {run_command, serve_command}) {
    tactus::wire::add_keys_option(*command, options.settings.side.keys,
                                  "Folder of keys that `tactus keys add-tester` has made; default: no encryption");
    command->add_option("--qos", options.settings.side.qos, "Directory of the QoS profiles");
    tactus::wire::add_discovery_options(*command, options.settings.side.discovery);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongInput;
  }
  const std::atomic<bool>& cancelled = tactus::realtime::stop_signal();
  try {
    return *serve_command
               ? serve_all(options, cancelled)
               : tactus::realtime::status_after_output("tactus-latency", run(options, run_info(argc, argv), cancelled));
  } catch (const std::exception& error) {
    std::cerr << "tactus-latency: " << tactus::session::printable(error.what()) << '\n';
    return kWrongInput;
  }
}
