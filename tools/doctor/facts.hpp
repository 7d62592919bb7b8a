/// The facts that `tactus-doctor` collects about this machine, before it judges them.
#pragma once

#include <atomic>
#include <cstdint>
#include <ctime>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "keys/member.hpp"
#include "wire/footprint.hpp"
#include "wire/participants.hpp"

namespace tactus::doctor {

/// An IPv4 address of an interface that is up.
struct Interface {
  std::string name, address;
  int mtu = 0;
  bool is_loopback = false;
  bool can_multicast = false;      ///< the interface reports the capability
  bool multicast_returns = false;  ///< a datagram sent through it to the discovery group came back to this machine
};

/// Lateness of the wake-ups of a thread with a period of 1 ms; microseconds.
struct Lateness {
  double p50 = 0, p99 = 0, max = 0;
};

struct Facts {
  std::vector<Interface> interfaces;
  std::string multicast_route_error;                ///< reason why the discovery group has no route; empty: has a route
  std::vector<std::string> unreachable;             ///< configured peers and servers without a route, with the reason
  wire::Footprint required;                         ///< sizes that the QoS profiles require
  int receive_buffer_max = 0, send_buffer_max = 0;  ///< net.core.rmem_max, wmem_max; bytes
  bool has_fifo = false;                            ///< SCHED_FIFO was granted at `priority`
  int priority = 0;
  bool can_lock_memory = false;
  long rt_runtime_us = 0;  ///< kernel.sched_rt_runtime_us: time of real-time threads in each second; -1: no limit
  Lateness lateness;
  std::string clock_source;  ///< empty: unknown
  double clock_read_ns = 0;  ///< cost of reading CLOCK_MONOTONIC
  int domain = 0;
  int local_programs = 0;              ///< other programs on this machine in the session domain
  std::vector<int> blocked_ports;      ///< discovery ports that another program uses and does not share
  int first_ephemeral_port = 0;        ///< first port of net.ipv4.ip_local_port_range
  std::optional<keys::Member> member;  ///< of the keys
  keys::RevokedKeys revoked;           ///< the list in the folder of the keys
  std::string keys_error;              ///< why the keys cannot be used; empty if they can, or if there are none
  std::time_t now = 0;
  std::string kernel, library;              ///< versions of the kernel and of Fast DDS
  std::vector<std::string> stale_segments;  ///< Fast DDS files in /dev/shm that no visible program uses
  std::vector<std::string> variables;       ///< environment variables that are set for the DDS library
  wire::Discovery discovery;                ///< as configured
  std::string join_error;                   ///< reason why this program could not join the domain; empty: it joined
  std::optional<double> match_time_s;       ///< time until two local participants matched in all classes; empty: never
};

/// Returns the names of the Fast DDS files in `folder` that no visible program uses, in lexicographic order. Only root
/// can inspect the programs of other users.
[[nodiscard]] std::vector<std::string> stale_segments(const std::filesystem::path& folder = "/dev/shm");

struct Settings {
  wire::SessionAddress address;  ///< domain, discovery, qos; collect_facts generates session and participant
  std::filesystem::path keys;    ///< folder of a program's keys; empty: none
  int priority = 60;
  double seconds = 2;  ///< duration of the lateness measurement
};

/// Inspects the machine, measures its lateness, and joins the domain briefly. Takes `seconds`, and up to 5 s for the
/// discovery test. Ends early when `cancelled` is set. Throws wire::WireError for a qos directory that cannot be read.
[[nodiscard]] Facts collect_facts(const Settings& settings, const std::atomic<bool>& cancelled);

}  // namespace tactus::doctor
