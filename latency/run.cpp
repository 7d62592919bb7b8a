#include "latency/run.hpp"

#include <exception>
#include <optional>
#include <thread>

#include "latency/serve_process.hpp"
#include "netem/pair.hpp"

namespace tactus::latency {
namespace {

/// Runs `work` in a thread of its own, so that the thread's real-time priority and namespace end with it.
template <class Work>
void in_own_thread(Work&& work) {
  std::exception_ptr error;
  std::thread{[&] {
    try {
      work();
    } catch (...) {
      error = std::current_exception();
    }
  }}.join();
  if (error != nullptr) std::rethrow_exception(error);
}

}  // namespace

Result run_with_server(const TestCase& test, ControlConnection& control, const SideSettings& side,
                       const std::atomic<bool>& cancelled) {
  Timestamps timestamps;
  in_own_thread([&] { timestamps = measure(test, control, side, cancelled); });
  return evaluate(timestamps);
}

Result run_locally(const TestCase& test, const RunSettings& settings, const std::atomic<bool>& cancelled) {
  return evaluate(measure_locally(test, settings, cancelled, {}));
}

Timestamps measure_locally(const TestCase& test, const RunSettings& settings, const std::atomic<bool>& cancelled,
                           const PingSelection& selection) {
  std::optional<netem::LinkedPair> pair;
  std::string note;
  if (test.link != "none") {
    netem::LinkSettings link = netem::parse_link(test.link);
    link.seed = settings.link_seed;
    pair.emplace(link);
    if (!pair->realtime()) note = "relay: no real-time priority, delays are less exact";
  }
  std::vector<std::string> options{"--qos", settings.side.qos.string(), "--priority",
                                   std::to_string(settings.side.priority)};
  if (!settings.side.keys.empty()) options.insert(options.end(), {"--keys", settings.side.keys.string()});
  for (const std::string& peer : settings.side.discovery.peers) options.insert(options.end(), {"--peer", peer});
  for (const std::string& server : settings.side.discovery.servers)
    options.insert(options.end(), {"--discovery-server", server});
  ServeProcess echoer{settings.echoer, options, cancelled, [&](std::vector<std::string> command) {
                        return pair ? pair->start(netem::Side::kB, std::move(command))
                                    : netem::start_program(std::move(command));
                      }};

  SideSettings side = settings.side;
  Timestamps timestamps;
  in_own_thread([&] {
    if (pair) {
      pair->enter_namespace(netem::Side::kA);
      side.echo_address = netem::LinkedPair::address(netem::Side::kB);
    }
    timestamps = measure(test, echoer.control(), side, cancelled, selection);
  });
  if (!note.empty()) timestamps.notes.push_back(note);
  return timestamps;
}

}  // namespace tactus::latency
