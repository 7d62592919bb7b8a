// tactus-latency: the QoS latency tests.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <map>
#include <optional>

#include "latency/report.hpp"
#include "latency/run.hpp"
#include "netem/profile.hpp"
#include "wire/command_line.hpp"
#include "wire/participants.hpp"
#include "wire/process.hpp"

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
  tactus-latency serve                      (on one)
  tactus-latency run --to OTHER-HOST        (on the other)

Options of axes accept several values, separated by commas; every combination is a test. Links need root.

Exit status: 0 done, 2 wrong input or missing support of machine or network, 130 interrupted.)";

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
  std::uint16_t port = kPort;
  int control = -1;
};

void add_run(CLI::App& app, Options& o) {
  add_axis(app, "--transport", o.grid.transports, kTransportNames,
           "Transport of the samples; raw-udp is the reference");
  add_axis(app, "--profile", o.grid.profiles, kProfileNames,
           "QoS: of qos/, the library's defaults, or the defaults with one participant");
  add_axis(app, "--topic", o.grid.topics, kTopicNames, "Topic of the samples");
  app.add_option("--payload", o.grid.payloads, "Bytes of a record or of a raw datagram; a probe state has 236")
      ->delimiter(',');
  app.add_option("--rate", o.grid.rates, "Pings per second")->delimiter(',')->default_str("1000");
  add_axis(app, "--coding", o.grid.codings, kCodingNames,
           "Pings sent: all, or those of a hand that the deadband coder sends");
  app.add_option("--readers", o.grid.readers, "Number of readers; each one answers")->delimiter(',')->default_str("1");
  app.add_option("--load", o.loads, "Mbit/s of mesh records as background load, or max")
      ->delimiter(',')
      ->default_str("0");
  app.add_option("--link", o.grid.links, "Link between the two sides: none, or one of `tactus-link list`")
      ->delimiter(',')
      ->default_str("none");
  app.add_option("--seconds", o.grid.seconds, "Length of each test")->capture_default_str();
  app.add_option("--repeat", o.grid.repeat, "Number of repetitions of all tests, alternating")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  app.add_option("--priority", o.settings.side.priority, "SCHED_FIFO priority of sender and receivers; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0, 98));
  app.add_option("--domain", o.settings.side.domain, "First of the three DDS domains to use")->capture_default_str();
  app.add_option("--seed", o.settings.link_seed, "Seed of emulated links")->capture_default_str();
  app.add_option("--to", o.to, "Host that runs `tactus-latency serve`; default: both sides run here");
  app.add_option("--port", o.port, "TCP port of `tactus-latency serve`")->capture_default_str();
  app.add_option("--json", o.json, "File for all figures");
  app.add_option("--html", o.html, "File for a page with plots");
}

void add_serve(CLI::App& app, Options& o) {
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

int run(Options& o, const Subject& subject, const std::atomic<bool>& stop) {
  o.grid.loads = parse_loads(o.loads);
  const std::vector<Cell> cells = o.grid.cells();
  for (const Cell& cell : cells)
    if (cell.link != "none") (void)netem::parse_link(cell.link);  // fail now rather than after an hour
  std::optional<Channel> channel;
  if (!o.to.empty()) {
    for (const Cell& cell : cells)
      if (cell.link != "none")
        throw LatencyError("link is '" + cell.link + "'; expected none with --to, where the real network is the link");
    channel.emplace(connect_to(o.to, o.port), stop);
    o.settings.side.echo_address = o.to;
  }
  std::vector<Result> results;
  int status = 0;
  for (const Cell& cell : cells) {
    std::cerr << "[" << results.size() + 1 << "/" << cells.size() << "] " << describe(cell) << '\n';
    try {
      results.push_back(channel ? run_against(cell, *channel, o.settings.side, stop)
                                : run_here(cell, o.settings, stop));
    } catch (const LatencyError& error) {
      if (!stop) throw;
      std::cerr << "tactus-latency: interrupted\n";
      status = kInterrupted;
      break;
    }
  }
  if (results.empty()) return status;
  print_table(std::cout, subject, results);
  if (!o.json.empty()) write_json(o.json, subject, results);
  if (!o.html.empty()) write_html(o.html, subject, results);
  return status;
}

int serve_all(const Options& o, const std::atomic<bool>& stop) {
  if (o.control >= 0) {
    Channel channel{o.control, stop};
    try {
      serve(channel, o.settings.side, stop);
    } catch (const LatencyError&) {  // sent to the other side, which prints it
      if (!stop) return kWrongInput;
    }
    return 0;
  }
  const int listener = listen_at(o.port);
  std::cerr << "listening on port " << port_of(listener) << "; the other side: tactus-latency run --to HOST\n";
  for (int socket; (socket = accept_from(listener, stop)) >= 0;) {
    std::cerr << "a pinger has connected\n";
    Channel channel{socket, stop};
    try {
      serve(channel, o.settings.side, stop);
      std::cerr << "the pinger has finished\n";
    } catch (const std::exception& error) {  // the next pinger may succeed
      if (!stop) std::cerr << "tactus-latency: " << error.what() << '\n';
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
  CLI::App* const run_command = app.add_subcommand("run", "Measure");
  CLI::App* const serve_command = app.add_subcommand("serve", "Answer a `run --to` on another machine, until Ctrl-C");
  add_run(*run_command, options);
  add_serve(*serve_command, options);
  for (CLI::App* const command : {run_command, serve_command}) {
    command->add_option("--qos", options.settings.side.qos, "Directory of the QoS profiles");
    tactus::wire::add_discovery_options(*command, options.settings.side.discovery);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongInput;
  }
  const std::atomic<bool>& stop = tactus::wire::stop_signal();
  try {
    return *serve_command ? serve_all(options, stop) : run(options, subject_of(argc, argv), stop);
  } catch (const std::exception& error) {
    std::cerr << "tactus-latency: " << error.what() << '\n';
    return kWrongInput;
  }
}
