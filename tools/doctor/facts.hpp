/// Facts that `tactus-doctor` collects on this machine, not yet judged.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "wire/footprint.hpp"
#include "wire/participants.hpp"

namespace tactus::doctor {

/// An IPv4 address of an interface that is up.
struct Interface {
  std::string name, address;
  int mtu = 0;
  bool loopback = false;
  bool multicast = false;  ///< the interface reports the capability
  bool received = false;   ///< a datagram to the discovery group through it came back to this machine
};

/// Lateness of wake-ups of a thread with a period of 1 ms; microseconds.
struct Lateness {
  double p50 = 0, p99 = 0, max = 0;
};

struct Facts {
  std::vector<Interface> interfaces;
  std::string multicast_route_error;                ///< empty: the system has a route to the discovery group
  std::vector<std::string> unreachable;             ///< of the configured peers and servers, with the reason
  wire::Footprint wanted;                           ///< required by the profiles
  int receive_buffer_max = 0, send_buffer_max = 0;  ///< net.core.rmem_max, wmem_max
  bool fifo = false;                                ///< SCHED_FIFO was granted at `priority`
  int priority = 0;
  bool memory_locks = false;
  long rt_runtime_us = 0;  ///< kernel.sched_rt_runtime_us, of 1 s; -1: no limit
  Lateness lateness;
  std::string clock_source;  ///< empty: unknown
  double clock_read_ns = 0;  ///< cost of reading CLOCK_MONOTONIC
  int domain = 0;
  int local_programs = 0;                   ///< other programs on this machine in the session domain
  std::vector<int> blocked_ports;           ///< discovery ports held by a program that does not share them
  int ephemeral_from = 0;                   ///< first ephemeral port of the system
  std::string kernel, library;              ///< versions
  std::vector<std::string> stale_segments;  ///< Fast DDS files in /dev/shm that no inspectable program has mapped
  std::vector<std::string> variables;       ///< environment variables for the DDS library
  wire::Discovery discovery;                ///< as configured
  std::string join_error;                   ///< why this program could not join; empty when it could
  std::optional<double> matched_after;      ///< s until two participants of this machine had matched on all classes
};

struct Settings {
  wire::SessionAddress address;  ///< domain, discovery, qos; session and participant are generated
  int priority = 60;
  double seconds = 2;  ///< duration of the lateness measurement
};

/// Inspects, measures and joins the domain briefly. Takes `seconds` plus up to 5 s for the discovery test; ends early
/// when `stop` is set. Throws wire::WireError for a qos directory that cannot be read.
[[nodiscard]] Facts collect_facts(const Settings& settings, const std::atomic<bool>& stop);

}  // namespace tactus::doctor
