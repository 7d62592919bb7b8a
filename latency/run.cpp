#include "latency/run.hpp"

#include <exception>
#include <optional>
#include <thread>

#include "latency/helper.hpp"
#include "netem/pair.hpp"

namespace tactus::latency {
namespace {

/// Runs `work` in a thread of its own, so that its real-time priority and namespace end with it.
template <class Work>
void in_own_thread(Work&& work) {
  std::exception_ptr trouble;
  std::thread{[&] {
    try {
      work();
    } catch (...) {
      trouble = std::current_exception();
    }
  }}.join();
  if (trouble != nullptr) std::rethrow_exception(trouble);
}

}  // namespace

Result run_against(const Cell& cell, Channel& channel, const SideSettings& side, const std::atomic<bool>& stop) {
  Stamps stamps;
  in_own_thread([&] { stamps = measure(cell, channel, side, stop); });
  return evaluate(stamps);
}

Result run_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop) {
  return evaluate(stamp_here(cell, settings, stop, {}));
}

Stamps stamp_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop, const Plan& plan) {
  std::optional<netem::LinkedPair> pair;
  std::string note;
  if (cell.link != "none") {
    netem::LinkSettings link = netem::parse_link(cell.link);
    link.seed = settings.link_seed;
    pair.emplace(link);
    if (!pair->realtime()) note = "relay: no real-time priority, delays are less exact";
  }
  std::vector<std::string> options{"--qos", settings.side.qos.string(), "--priority",
                                   std::to_string(settings.side.priority)};
  for (const std::string& peer : settings.side.discovery.peers) options.insert(options.end(), {"--peer", peer});
  for (const std::string& server : settings.side.discovery.servers)
    options.insert(options.end(), {"--discovery-server", server});
  Helper echoer{settings.echoer, options, stop, [&](std::vector<std::string> command) {
                  return pair ? pair->start(netem::Side::kB, std::move(command))
                              : netem::start_program(std::move(command));
                }};

  SideSettings side = settings.side;
  Stamps stamps;
  in_own_thread([&] {
    if (pair) {
      pair->enter(netem::Side::kA);
      side.echo_address = netem::LinkedPair::address(netem::Side::kB);
    }
    stamps = measure(cell, echoer.channel(), side, stop, plan);
  });
  if (!note.empty()) stamps.notes.push_back(note);
  return stamps;
}

}  // namespace tactus::latency
