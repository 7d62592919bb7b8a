/// What `tactus-doctor` looks at on this machine, before anything is judged.
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
  bool multicast = false;  ///< the interface says that it can
  bool received = false;   ///< a datagram to the discovery group, sent through it, came back to this machine
};

/// How a thread with a period of 1 ms wakes up; microseconds late.
struct Lateness {
  double p50 = 0, p99 = 0, max = 0;
};

struct Facts {
  std::vector<Interface> interfaces;
  std::string multicast_route_error;                ///< empty: the system knows where to send to the discovery group
  std::vector<std::string> unreachable;             ///< of the peers and servers asked for, with the reason
  wire::Footprint wanted;                           ///< by the profiles
  int receive_buffer_max = 0, send_buffer_max = 0;  ///< net.core.rmem_max, wmem_max
  bool fifo = false;                                ///< SCHED_FIFO at the priority asked for was had
  int priority = 0;
  bool memory_locks = false;
  long rt_runtime_us = 0;  ///< kernel.sched_rt_runtime_us, of 1 s; -1: no limit
  Lateness lateness;
  std::string clock_source;  ///< empty: not told
  double clock_read_ns = 0;  ///< what it takes to read CLOCK_MONOTONIC
  int domain = 0;
  int programs_here = 0;                ///< in the session domain, on this machine, others than this
  std::vector<int> blocked_ports;       ///< discovery ports that a program has which does not share them
  int ephemeral_from = 0;               ///< the first port that the system gives away
  std::string kernel, library;          ///< versions
  std::vector<std::string> leftovers;   ///< in /dev/shm, of Fast DDS, mapped by no program that can be looked into
  std::vector<std::string> variables;   ///< of the environment, meant for the library
  wire::Discovery discovery;            ///< as asked for
  std::string meeting_error;            ///< why this program could not join
  std::optional<double> meeting_after;  ///< s, in which two participants of this machine had met on all classes
};

struct Settings {
  wire::SessionAddress address;  ///< domain, discovery, qos; session and participant are made up
  int priority = 60;
  double seconds = 2;  ///< of the measurement of lateness
};

/// Looks, measures and joins the domain for a moment. Takes `seconds` and up to 5 s for the meeting; ends early when
/// `stop` is set. Throws wire::WireError for a qos directory that cannot be read.
[[nodiscard]] Facts look(const Settings& settings, const std::atomic<bool>& stop);

}  // namespace tactus::doctor
