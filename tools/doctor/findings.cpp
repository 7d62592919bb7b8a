#include "tools/doctor/findings.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "session/messages.hpp"

namespace tactus::doctor {
namespace {

constexpr int kHeaders = 28;            // IPv4 and UDP
constexpr double kLateAdvice_us = 200;  // p99; a fifth of a cycle of 1 ms
constexpr double kSlowClock_ns = 200;   // a system call instead of a vDSO read
constexpr int kLastProgram = 119;       // number of programs per machine in one domain, minus one
constexpr long kRtRuntime_us = 950000;  // the kernel's default

using wire::discovery_port;

class Findings {
 public:
  void good(const char* topic, std::string found) { all.push_back({Severity::kGood, topic, std::move(found), {}}); }
  void advice(const char* topic, std::string found, std::string remedy) {
    all.push_back({Severity::kAdvice, topic, std::move(found), std::move(remedy)});
  }
  void fault(const char* topic, std::string found, std::string remedy) {
    all.push_back({Severity::kFault, topic, std::move(found), std::move(remedy)});
  }
  std::vector<Finding> all;
};

std::string number(double value) { return std::to_string(static_cast<long>(std::lround(value))); }

template <class List>
std::string joined(const List& list) {
  std::string all;
  for (const auto& item : list) all += (all.empty() ? "" : ", ") + item;
  return all;
}

bool by_multicast(const Facts& facts) { return facts.discovery.peers.empty() && facts.discovery.servers.empty(); }

void judge_network(const Facts& facts, Findings& to) {
  std::vector<std::string> outside, unreceived, narrow;
  for (const Interface& i : facts.interfaces) {
    if (i.loopback) continue;
    outside.push_back(i.name + " " + i.address);
    if (!i.received) unreceived.push_back(i.name + (i.multicast ? "" : " (multicast is off)"));
    if (i.mtu < facts.wanted.message + kHeaders) narrow.push_back(i.name + " " + std::to_string(i.mtu));
  }
  if (outside.empty()) {
    to.advice("interfaces", "loopback only", "connect a network; a session on this machine alone works");
  } else if (outside.size() > 1) {
    to.advice("interfaces", joined(outside) + ": all are announced to other machines, reachable or not",
              "take down interfaces that the session does not use, or run it in a network namespace");
  } else {
    to.good("interfaces", joined(outside));
  }

  const char* const multicast = "multicast";
  const std::string instead = ", or use --peer or --discovery-server";
  if (!by_multicast(facts)) {
    to.good(multicast, "not needed with --peer or --discovery-server");
  } else if (!facts.multicast_route_error.empty()) {
    to.fault(multicast, "no route to 239.255.0.1: " + facts.multicast_route_error,
             "ip route add 239.0.0.0/8 dev INTERFACE" + instead);
  } else if (!unreceived.empty()) {
    to.fault(multicast, "datagrams to 239.255.0.1 do not come back on " + joined(unreceived),
             "ip link set INTERFACE multicast on; let a firewall pass UDP to 239.255.0.1" + instead);
  } else {
    to.good(
        multicast,
        "works on every interface of this machine; between machines test with tactus latency serve and run --to HOST");
  }

  if (!facts.unreachable.empty()) {
    to.fault("routes", "no route to " + joined(facts.unreachable), "see the names and ip route; ip route get ADDRESS");
  } else if (!by_multicast(facts)) {
    to.good("routes", "to every configured peer and server");
  }

  const std::string frame = std::to_string(facts.wanted.message + kHeaders);
  if (narrow.empty()) {
    to.good("mtu", "at least " + frame + " bytes, the largest datagram");
  } else {
    to.advice(
        "mtu",
        joined(narrow) + ": datagrams of " + frame + " bytes are fragmented, and one lost fragment loses the datagram",
        "ip link set INTERFACE mtu " + frame + ", if the network carries frames of this size");
  }
}

void judge_buffers(const Facts& facts, Findings& to) {
  const auto compare = [&](const char* key, int have, int want) {
    const std::string name = std::string{"net.core."} + key;
    if (have >= want) {
      to.good("socket buffers", name + " is " + std::to_string(have));
    } else {
      to.advice("socket buffers",
                name + " is " + std::to_string(have) + ", the profiles require " + std::to_string(want) +
                    ": bursts of records may be lost and repeated",
                "sysctl -w " + name + "=" + std::to_string(want));
    }
  };
  compare("rmem_max", facts.receive_buffer_max, facts.wanted.receive_buffer);
  compare("wmem_max", facts.send_buffer_max, facts.wanted.send_buffer);
}

void judge_time(const Facts& facts, Findings& to) {
  if (facts.fifo) {
    to.good("real time", "SCHED_FIFO " + std::to_string(facts.priority) + " is available");
  } else {
    to.advice(
        "real time",
        "SCHED_FIFO " + std::to_string(facts.priority) + " is refused: cycles will be late when other programs run",
        "'USER - rtprio 98' in /etc/security/limits.conf and a new login; in a container --cap-add SYS_NICE "
        "--ulimit rtprio=98");
  }
  if (facts.memory_locks) {
    to.good("locked memory", "is available");
  } else {
    to.advice("locked memory", "is refused: a page fault may delay a cycle",
              "'USER - memlock unlimited' in /etc/security/limits.conf and a new login; in a container --ulimit "
              "memlock=-1");
  }
  if (facts.rt_runtime_us < 0 || facts.rt_runtime_us > kRtRuntime_us) {
    to.advice("real-time share",
              "kernel.sched_rt_runtime_us is " + std::to_string(facts.rt_runtime_us) +
                  ": a spinning real-time thread, for instance of Fast DDS, would block the machine",
              "sysctl -w kernel.sched_rt_runtime_us=" + std::to_string(kRtRuntime_us));
  } else {
    to.good("real-time share", std::to_string(facts.rt_runtime_us) + " us of each second");
  }

  const Lateness& late = facts.lateness;
  const std::string found =
      "of a 1 kHz timer: p50 " + number(late.p50) + ", p99 " + number(late.p99) + ", max " + number(late.max) + " us";
  if (late.p99 > kLateAdvice_us) {
    to.advice("wake-up", found,
              "end other programs; grant real-time priority (above); turn off processor idle states: tuned-adm profile "
              "latency-performance, or cpupower idle-set -D 10");
  } else {
    to.good("wake-up", found);
  }

  static const std::set<std::string> kSlow{"hpet", "acpi_pm", "jiffies", "refined-jiffies"};
  const std::string clock = (facts.clock_source.empty() ? "unknown source" : facts.clock_source) + ", " +
                            number(facts.clock_read_ns) + " ns to read";
  if (kSlow.count(facts.clock_source) != 0 || facts.clock_read_ns > kSlowClock_ns) {
    to.advice("clock", clock + ": every timestamp is a system call",
              "echo tsc > /sys/devices/system/clocksource/clocksource0/current_clocksource, if available_clocksource "
              "has it");
  } else {
    to.good("clock", clock);
  }
}

void judge_domain(const Facts& facts, Findings& to) {
  const std::string which = "domain " + std::to_string(facts.domain);
  if (!facts.blocked_ports.empty()) {
    std::vector<std::string> ports;
    for (const int port : facts.blocked_ports) ports.push_back(std::to_string(port));
    to.fault("ports", "UDP " + joined(ports) + " of " + which + " are in use by a program that does not share them",
             "find it with ss -lunp; end it or use another --domain");
  } else if (const int last = discovery_port(facts.domain + wire::kTrafficClasses - 1) + 11 + 2 * kLastProgram;
             facts.ephemeral_from <= last) {
    to.advice("ports",
              which + " uses up to " + std::to_string(last) + ", ephemeral ports of the system begin at " +
                  std::to_string(facts.ephemeral_from),
              "a smaller --domain, or sysctl -w net.ipv4.ip_local_port_range='32768 60999'");
  } else {
    to.good("ports", which + ": UDP " + std::to_string(discovery_port(facts.domain)) +
                         " and up, programs on this machine: " + std::to_string(facts.local_programs));
  }

  const std::string how = !facts.discovery.servers.empty() ? "through " + joined(facts.discovery.servers)
                          : !facts.discovery.peers.empty() ? "as peers"
                                                           : "by multicast";
  if (!facts.join_error.empty()) {
    to.fault("discovery", "cannot join " + which + ": " + facts.join_error,
             "correct the faults above or the stated reason");
  } else if (facts.matched_after) {
    to.good("discovery", "two participants here found each other " + how + " in " + number(*facts.matched_after * 1e3) +
                             " ms on all three classes");
  } else {
    to.fault("discovery", "two participants here did not find each other " + how,
             facts.discovery.servers.empty()
                 ? "let a firewall pass UDP " + std::to_string(discovery_port(facts.domain)) + " and up, in and out"
                 : "is the server running? fast-discovery-server -i 0 -p 11811 -x " +
                       std::string{"QOS/discovery_server.xml"});
  }
}

void judge_software(const Facts& facts, Findings& to) {
  to.good("versions", "tactus " TACTUS_VERSION ", protocol " + std::to_string(session::kProtocolVersion) +
                          ", Fast DDS " + facts.library + ", kernel " + facts.kernel);
  if (facts.library == "2.9.1") {
    to.advice(
        "known faults",
        "Fast DDS 2.9.1 as packaged by Debian 12 has published faults (CVE-2024-28231, CVE-2025-64438 and some 30 "
        "more) that a single packet can trigger",
        "use it in trusted networks only; let a firewall pass UDP 7400 to 32000 from known machines "
        "only");
  }
  if (facts.stale_segments.empty()) {
    to.good("shared memory", "no segments of ended programs in /dev/shm");
  } else {
    to.advice("shared memory",
              std::to_string(facts.stale_segments.size()) + " segments of ended programs in /dev/shm, for example " +
                  facts.stale_segments.front(),
              "fastdds shm clean (Debian: fastdds-tools)");
  }
  if (facts.variables.empty()) {
    to.good("environment", "sets no variable of the DDS library");
  } else {
    to.advice("environment", joined(facts.variables) + ": sessions ignore these variables",
              "unset; use --peer, --discovery-server and --qos");
  }
}

}  // namespace

std::vector<Finding> judge(const Facts& facts) {
  Findings findings;
  judge_network(facts, findings);
  judge_buffers(facts, findings);
  judge_time(facts, findings);
  judge_domain(facts, findings);
  judge_software(facts, findings);
  return findings.all;
}

std::string text(const std::vector<Finding>& findings) {
  std::string all;
  int faults = 0, advices = 0;
  for (const Finding& f : findings) {
    char head[64];
    std::snprintf(head, sizeof head, "%-7s %-16s ",
                  f.severity == Severity::kGood ? "" : kSeverityNames[static_cast<int>(f.severity)], f.topic.c_str());
    all += head + f.found + "\n";
    if (!f.remedy.empty()) all += std::string(25, ' ') + "-> " + f.remedy + "\n";
    faults += f.severity == Severity::kFault ? 1 : 0;
    advices += f.severity == Severity::kAdvice ? 1 : 0;
  }
  return all + "faults: " + std::to_string(faults) + ", advices: " + std::to_string(advices) + "\n";
}

std::string json(const std::vector<Finding>& findings) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const Finding& f : findings)
    all.push_back({{"severity", kSeverityNames[static_cast<int>(f.severity)]},
                   {"topic", f.topic},
                   {"found", f.found},
                   {"mend", f.remedy}});
  return nlohmann::ordered_json{{"findings", all}}.dump(2) + "\n";
}

}  // namespace tactus::doctor
