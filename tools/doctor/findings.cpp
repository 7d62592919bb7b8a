#include "tools/doctor/findings.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "session/messages.hpp"
#include "session/printable.hpp"
#include "tools/doctor/vulnerabilities.hpp"

namespace tactus::doctor {
namespace {

constexpr int kIpAndUdpBytes = 28;         // headers of IPv4 and UDP
constexpr double kMaxP99_us = 200;         // lateness: a fifth of a cycle of 1 ms
constexpr double kMaxClockRead_ns = 200;   // a read through the vDSO takes less, a system call takes more
constexpr int kMaxProgram = 119;           // from 0; the ports of program 120 would belong to the next domain
constexpr long kMaxRtRuntime_us = 950000;  // the kernel's default
constexpr int kMaxPriority = 98;           // of every --priority option

using wire::discovery_port;

class Findings {
 public:
  void good(const char* check, std::string found) { all.push_back({Severity::kGood, check, std::move(found), {}}); }
  void advice(const char* check, std::string found, std::string remedy) {
    all.push_back({Severity::kAdvice, check, std::move(found), std::move(remedy)});
  }
  void fault(const char* check, std::string found, std::string remedy) {
    all.push_back({Severity::kFault, check, std::move(found), std::move(remedy)});
  }
  std::vector<Finding> all;
};

std::string rounded(double value) { return std::to_string(static_cast<long>(std::lround(value))); }

template <class List>
std::string joined(const List& list) {
  std::string all;
  for (const auto& item : list) all += (all.empty() ? "" : ", ") + item;
  return all;
}

bool uses_multicast(const Facts& facts) { return facts.discovery.peers.empty() && facts.discovery.servers.empty(); }

void judge_interfaces(const Facts& facts, Findings& findings) {
  std::vector<std::string> announced;
  for (const Interface& i : facts.interfaces)
    if (!i.is_loopback) announced.push_back(i.name + " " + i.address);
  if (announced.empty()) {
    findings.advice("interfaces", "loopback only", "connect a network; a session on this machine alone works");
  } else if (announced.size() > 1) {
    findings.advice("interfaces",
                    joined(announced) + ": sessions announce all of them, even if others cannot reach them",
                    "take down the interfaces that the session does not use, or run it in a network namespace");
  } else {
    findings.good("interfaces", joined(announced));
  }
}

/// The interface of a remedy: the only one, or a word for it.
std::string interface_of(const std::vector<std::string>& names) {
  return names.size() == 1 ? names.front() : "INTERFACE";
}
std::vector<std::string> network_interfaces(const Facts& facts) {
  std::vector<std::string> names;
  for (const Interface& i : facts.interfaces)
    if (!i.is_loopback) names.push_back(i.name);
  return names;
}

void judge_reachability(const Facts& facts, Findings& findings) {
  std::vector<std::string> without_multicast;
  for (const Interface& i : facts.interfaces)
    if (!i.is_loopback && !i.multicast_returns)
      without_multicast.push_back(i.name + (i.can_multicast ? "" : " (multicast is off)"));
  const char* const multicast = "multicast";
  const std::string or_unicast = ", or use --peer or --discovery-server";
  if (!uses_multicast(facts)) {
    findings.good(multicast, "not needed with --peer or --discovery-server");
  } else if (network_interfaces(facts).empty()) {
    findings.good(multicast, "not needed on this machine alone");
  } else if (!facts.multicast_route_error.empty()) {
    findings.fault(multicast, "no route to 239.255.0.1: " + facts.multicast_route_error,
                   "ip route add 239.0.0.0/8 dev " + interface_of(network_interfaces(facts)) + or_unicast);
  } else if (!without_multicast.empty()) {
    findings.fault(multicast, "datagrams to 239.255.0.1 do not come back on " + joined(without_multicast),
                   "ip link set " + interface_of(network_interfaces(facts)) +
                       " multicast on, let the firewall pass UDP to 239.255.0.1" + or_unicast);
  } else {
    findings.good(multicast,
                  "works on every interface of this machine; to test it between two machines, run tactus latency serve "
                  "on one and tactus latency run --to HOST on the other");
  }

  if (!facts.unreachable.empty()) {
    findings.fault("routes", "no route to " + joined(facts.unreachable),
                   "correct the name or address, or add a route; ip route get ADDRESS tests a route");
  } else if (!uses_multicast(facts)) {
    findings.good("routes", "exist to every configured peer and server");
  }
}

void judge_mtu(const Facts& facts, Findings& findings) {
  const int max_datagram = facts.required.message + kIpAndUdpBytes;
  std::vector<std::string> too_small, names;
  for (const Interface& i : facts.interfaces) {
    if (i.is_loopback || i.mtu >= max_datagram) continue;
    too_small.push_back(i.name + " " + std::to_string(i.mtu));
    names.push_back(i.name);
  }
  const std::string size = std::to_string(max_datagram);
  if (too_small.empty()) {
    findings.good("mtu", "at least " + size + " bytes, the size of the largest datagram");
  } else {
    findings.advice(
        "mtu",
        joined(too_small) + ": datagrams of " + size +
            " bytes are fragmented, and one lost fragment loses the datagram",
        "ip link set " + interface_of(names) + " mtu " + size + ", if the network carries frames of this size");
  }
}

void judge_buffers(const Facts& facts, Findings& findings) {
  const auto judge_limit = [&](const char* key, int limit, int required) {
    const std::string name = std::string{"net.core."} + key;
    if (limit >= required) {
      findings.good("socket buffers", name + " is " + std::to_string(limit));
    } else {
      findings.advice("socket buffers",
                      name + " is " + std::to_string(limit) + ", the profiles require " + std::to_string(required) +
                          ": records of a burst may be lost and sent again",
                      "sysctl -w " + name + "=" + std::to_string(required));
    }
  };
  judge_limit("rmem_max", facts.receive_buffer_max, facts.required.receive_buffer);
  judge_limit("wmem_max", facts.send_buffer_max, facts.required.send_buffer);
}

void judge_realtime(const Facts& facts, Findings& findings) {
  const std::string fifo = "SCHED_FIFO " + std::to_string(facts.priority);
  if (facts.has_fifo) {
    findings.good("real time", fifo + " is available");
  } else {
    const std::string max = std::to_string(kMaxPriority);
    findings.advice("real time", fifo + " is refused: cycles will be late when other programs run",
                    "allow all priorities up to " + max + ": run 'usermod -a -G tactus USER' if tactus-services is " +
                        "installed, otherwise add 'USER - rtprio " + max +
                        "' to /etc/security/limits.conf; then log in again; in a container use --cap-add SYS_NICE "
                        "--ulimit rtprio=" +
                        max);
  }
  if (facts.can_lock_memory) {
    findings.good("locked memory", "is available");
  } else {
    findings.advice("locked memory", "is refused: a page fault may delay a cycle",
                    "run 'usermod -a -G tactus USER' if tactus-services is installed, otherwise add 'USER - memlock "
                    "unlimited' to /etc/security/limits.conf; then log in again; in a container use "
                    "--ulimit memlock=-1");
  }
  if (facts.rt_runtime_us < 0 || facts.rt_runtime_us > kMaxRtRuntime_us) {
    findings.advice("real-time share",
                    "kernel.sched_rt_runtime_us is " + std::to_string(facts.rt_runtime_us) +
                        ": a spinning real-time thread, for instance of Fast DDS, would block the machine",
                    "sysctl -w kernel.sched_rt_runtime_us=" + std::to_string(kMaxRtRuntime_us));
  } else {
    findings.good("real-time share",
                  "real-time threads get " + std::to_string(facts.rt_runtime_us) + " us of each second");
  }

  const Lateness& late = facts.lateness;
  const std::string found = "lateness of a 1 kHz timer: p50 " + rounded(late.p50) + ", p99 " + rounded(late.p99) +
                            ", max " + rounded(late.max) + " us";
  if (late.p99 > kMaxP99_us) {
    findings.advice("wake-up", found,
                    "end other programs; allow real-time priority (see above); turn off the idle states of the "
                    "processor: tuned-adm profile latency-performance, or cpupower idle-set -D 10");
  } else {
    findings.good("wake-up", found);
  }
}

void judge_clock(const Facts& facts, Findings& findings) {
  static const std::set<std::string> kSlow{"hpet", "acpi_pm", "jiffies", "refined-jiffies"};
  const std::string clock = (facts.clock_source.empty() ? "unknown source" : facts.clock_source) + ", " +
                            rounded(facts.clock_read_ns) + " ns to read";
  if (kSlow.count(facts.clock_source) != 0 || facts.clock_read_ns > kMaxClockRead_ns) {
    findings.advice("clock", clock + ": every timestamp is a system call",
                    "echo tsc > /sys/devices/system/clocksource/clocksource0/current_clocksource, if "
                    "available_clocksource in the same directory lists tsc");
  } else {
    findings.good("clock", clock);
  }
}

void judge_domain(const Facts& facts, Findings& findings) {
  const std::string domain = "domain " + std::to_string(facts.domain);
  const int last_port = wire::own_port(facts.domain + wire::kTrafficClasses - 1, kMaxProgram) + 1;
  if (!facts.blocked_ports.empty()) {
    std::vector<std::string> ports;
    for (const int port : facts.blocked_ports) ports.push_back(std::to_string(port));
    findings.fault("ports", domain + ": another program uses UDP " + joined(ports) + " and does not share the port",
                   "find the program with ss -lunp; end it or use another --domain");
  } else if (facts.first_ephemeral_port <= last_port) {
    findings.advice("ports",
                    domain + " uses ports up to " + std::to_string(last_port) +
                        ", but the ephemeral ports of the system begin at " +
                        std::to_string(facts.first_ephemeral_port),
                    "use a smaller --domain, or sysctl -w net.ipv4.ip_local_port_range='32768 60999'");
  } else {
    findings.good("ports", domain + ": UDP " + std::to_string(discovery_port(facts.domain)) +
                               " and above; other programs on this machine: " + std::to_string(facts.local_programs));
  }
}

void judge_discovery(const Facts& facts, Findings& findings) {
  const std::string method = !facts.discovery.servers.empty() ? "through " + joined(facts.discovery.servers)
                             : !facts.discovery.peers.empty() ? "through the named peers"
                                                              : "by multicast";
  if (!facts.join_error.empty()) {
    findings.fault("discovery", "cannot join domain " + std::to_string(facts.domain) + ": " + facts.join_error,
                   "correct the reason in this message, or the faults above");
  } else if (facts.match_time_s) {
    findings.good("discovery", "two participants of this machine found each other " + method + " in " +
                                   rounded(*facts.match_time_s * 1e3) +
                                   " ms in all three traffic classes; this does not test the network");
  } else {
    findings.fault("discovery", "two participants of this machine did not find each other " + method,
                   facts.discovery.servers.empty()
                       ? "let the firewall pass UDP " + std::to_string(discovery_port(facts.domain)) +
                             " and above in both directions"
                       : "start the server if it does not run: fast-discovery-server -i 0 -p 11811 -x "
                         "QOS_DIRECTORY/discovery_server.xml");
  }
}

void judge_keys(const Facts& facts, Findings& findings) {
  constexpr std::time_t kDay = 24 * 3600, kSoon = 14 * kDay;
  if (!facts.keys_error.empty()) {
    findings.fault("keys", facts.keys_error, "docs/how-to/secure.md explains the folder and its rights");
    return;
  }
  if (!facts.member) {
    findings.good("keys", "none given with --keys; without keys, a session is for one machine");
    return;
  }
  const keys::Member& member = *facts.member;
  const std::string found = std::string{keys::name_of(member.role)} + " '" + member.name + "' of the authority '" +
                            member.group + "', valid until " + keys::utc_text(member.valid_until, "%Y-%m-%d") + "; " +
                            keys::text_of(facts.revoked);
  if (member.valid_until - facts.now < kSoon)
    findings.advice("keys", "expire in " + std::to_string((member.valid_until - facts.now) / kDay) + " days: " + found,
                    "on the machine of the authority: " + keys::replace_command(member));
  else
    findings.good("keys", found);
  if (const std::string warning = keys::clock_warning(facts.revoked, facts.now); !warning.empty())
    findings.advice("keys", warning, "docs/how-to/secure.md explains how to replace keys");
}

void judge_software(const Facts& facts, Findings& findings) {
  findings.good("versions", "tactus " TACTUS_VERSION ", protocol " + std::to_string(session::kProtocolVersion) +
                                ", Fast DDS " + facts.library + ", kernel " + facts.kernel);
  int open = 0;
  for (const Vulnerability& one : vulnerabilities(facts.library)) open += one.count;
  if (open > 0)
    findings.advice("vulnerabilities",
                    "the Debian package of Fast DDS " + facts.library + " lacks corrections of " +
                        std::to_string(open) + " published vulnerabilities (CVE), many of which need only a packet",
                    "tactus doctor --vulnerabilities lists them; let the firewall pass UDP 7400 to 32767 from known "
                    "machines only");
  if (facts.stale_segments.empty()) {
    findings.good("shared memory", "no segments of ended programs in /dev/shm");
  } else {
    findings.advice("shared memory",
                    std::to_string(facts.stale_segments.size()) +
                        " segments of ended programs in /dev/shm, for example " + facts.stale_segments.front(),
                    "fastdds shm clean (Debian: fastdds-tools)");
  }
  if (facts.variables.empty()) {
    findings.good("environment", "sets no variable of the DDS library");
  } else {
    findings.advice("environment", joined(facts.variables) + ": sessions ignore these variables",
                    "unset them; use --peer, --discovery-server and --qos");
  }
}

}  // namespace

std::vector<Finding> judge(const Facts& facts) {
  Findings findings;
  judge_interfaces(facts, findings);
  judge_reachability(facts, findings);
  judge_mtu(facts, findings);
  judge_buffers(facts, findings);
  judge_realtime(facts, findings);
  judge_clock(facts, findings);
  judge_domain(facts, findings);
  judge_discovery(facts, findings);
  judge_keys(facts, findings);
  judge_software(facts, findings);
  return findings.all;
}

std::string text(const std::vector<Finding>& findings) {
  std::string all;
  int faults = 0, advice = 0;
  for (const Finding& f : findings) {
    char head[64];
    std::snprintf(head, sizeof head, "%-7s %-16s ",
                  f.severity == Severity::kGood ? "" : kSeverityNames[static_cast<int>(f.severity)], f.check.c_str());
    all += head + session::printable(f.found) + "\n";
    if (!f.remedy.empty()) all += std::string(25, ' ') + "-> " + session::printable(f.remedy) + "\n";
    faults += f.severity == Severity::kFault ? 1 : 0;
    advice += f.severity == Severity::kAdvice ? 1 : 0;
  }
  return all + "faults: " + std::to_string(faults) + ", advice: " + std::to_string(advice) + "\n";
}

std::string json(const std::vector<Finding>& findings) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const Finding& f : findings)
    all.push_back({{"severity", kSeverityNames[static_cast<int>(f.severity)]},
                   {"check", f.check},
                   {"found", f.found},
                   {"remedy", f.remedy}});
  using Json = nlohmann::ordered_json;  // names of files and interfaces may not be UTF-8
  return Json{{"findings", all}}.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace tactus::doctor
