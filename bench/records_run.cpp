#include "bench/records_run.hpp"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

#include "bench/in_namespace.hpp"
#include "latency/load.hpp"
#include "netem/pair.hpp"
#include "realtime/process.hpp"

namespace tactus::bench {
namespace {

/// Number of IP fragments that the namespace of the constructing thread has received since its begin.
struct ReceivedFragments {
  double count = kUnfinished;
  ReceivedFragments() {
    // Of two lines that begin with "Ip:", the first has the names of the values in the second.
    std::ifstream file{"/proc/thread-self/net/snmp"};
    std::string names_line, values_line;
    if (!std::getline(file, names_line) || !std::getline(file, values_line)) return;
    std::istringstream names{names_line}, values{values_line};
    for (std::string name, value; names >> name && values >> value;)
      if (name == "ReasmReqds") count = std::stod(value);
  }
};

void wait(double seconds, const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (std::chrono::steady_clock::now() < end && !stop)
    std::this_thread::sleep_for(std::chrono::milliseconds{10});  // other threads measure
}

}  // namespace

RecordsRun run_records(const std::string& link, double seconds, std::size_t burst_bytes, std::uint64_t seed,
                       const std::atomic<bool>& stop) {
  netem::LinkSettings settings = netem::parse_link(link);
  settings.seed = seed;
  const netem::LinkedPair pair{settings};
  wire::SessionAddress address;
  address.session = "records." + std::to_string(::getpid());
  address.participant = "host";
  address.is_test = true;
  latency::TestCase cell;
  cell.load_mbit = latency::kUnpaced;
  const auto sink = make_in_namespace<latency::MeshSink>(pair, netem::Side::kB, cell, address, burst_bytes);
  const auto load = make_in_namespace<latency::MeshSource>(pair, netem::Side::kA, cell, address);
  for (int i = 0; i < 2000 && !load->matched() && !stop; ++i) wait(0.01, stop);
  if (!load->matched()) throw netem::LinkError("the two sides have not discovered each other over " + link);
  load->start();
  // Where the link loses many frames, discovery takes seconds.
  for (int i = 0; i < 3000 && sink->bytes() == 0 && !stop; ++i) wait(0.01, stop);
  if (sink->bytes() == 0) throw netem::LinkError("no records have arrived within 30 s over " + link);
  wait(seconds / 5, stop);

  (void)sink->take_bursts();
  const std::uint64_t received_before = sink->bytes(), sent_before = load->sent_bytes();
  const std::int64_t began = realtime::monotonic_ns();
  wait(seconds, stop);
  RecordsRun run;
  const auto bytes = static_cast<double>(sink->bytes() - received_before);
  const std::int64_t ended = realtime::monotonic_ns();
  run.mbyte_per_s = bytes * 1e3 / static_cast<double>(ended - began);
  run.sent_per_received = bytes > 0 ? static_cast<double>(load->sent_bytes() - sent_before) / bytes : 0;
  Samples sizes;
  std::int64_t last_ns = began, longest_gap_ns = 0;
  for (const latency::MeshSink::Burst& burst : sink->take_bursts()) {
    run.burst_ms.add(burst.ms);
    sizes.add(static_cast<double>(burst.bytes) * 1e-3);
    longest_gap_ns = std::max(longest_gap_ns, burst.end_ns - last_ns);
    last_ns = burst.end_ns;
  }
  run.longest_gap_ms = static_cast<double>(std::max(longest_gap_ns, ended - last_ns)) * 1e-6;
  run.burst_kb = sizes.mean();
  for (const netem::Side side : {netem::Side::kA, netem::Side::kB})
    run.fragments += make_in_namespace<ReceivedFragments>(pair, side)->count;
  return run;
}

}  // namespace tactus::bench
