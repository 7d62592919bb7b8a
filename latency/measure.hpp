/// Measures the times of one test. `measure` is the pinger's side, `serve` the echoers' side; a ControlConnection joins
/// the two sides.
///
///     pinger                              echoer (one for each reader of the test)
///     intended, sent ----- ping ----->    received           age = received - intended, on one clock
///     arrived       <----- echo ------    echoed             half round trip = (arrived - intended) / 2
///
/// A fixed schedule states the intended time of each ping. A ping is sent late if the pinger wakes up late or if the
/// previous ping blocked it. Even then, age and round trip count from the intended time. Otherwise the times would omit
/// the delays that the pinger itself had (coordinated omission).
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "latency/control_connection.hpp"
#include "latency/test_case.hpp"
#include "wire/participants.hpp"

namespace tactus::latency {

struct Ping {
  std::int64_t intended_ns = 0, sent_ns = 0;  ///< pinger's clock; sent_ns is 0 if the ping was not sent
  bool waited = false;                        ///< the pinger slept until the intended time, so nothing blocked it
  bool refused = false;                       ///< the carrier refused the ping for at least one echoer
};
/// Arrival of a ping at an echoer.
struct Arrival {
  std::uint32_t sequence = 0, reader = 0;  ///< numbers of the ping and of the echoer, from 0
  std::int64_t received_ns = 0;            ///< echoer's clock
};
struct Echo {
  std::uint32_t sequence = 0, reader = 0;
  std::int64_t received_ns = 0, echoed_ns = 0;  ///< echoer's clock
  std::int64_t arrived_ns = 0;                  ///< pinger's clock
};

/// All timestamps of a test. Arrivals and echoes are in order of arrival and include duplicates.
struct Timestamps {
  TestCase test;
  std::vector<Ping> pings;  ///< by sequence number
  std::vector<Arrival> arrivals;
  std::vector<Echo> echoes;
  bool shares_clock = false;       ///< both sides read the same clock
  double load_bytes_per_s = 0;     ///< payload of the load that arrived
  std::vector<std::string> notes;  ///< real-time priorities of both sides
};

/// Settings of one side of the tests.
struct SideSettings {
  std::string echo_address = "127.0.0.1";  ///< address of the echoers' machine, as seen from the pinger
  int domain = 20;                         ///< first of three DDS domains
  wire::Discovery discovery;               ///< each side has its own; unused with raw-udp
  std::filesystem::path qos;
  std::filesystem::path keys;  ///< folder of keys with role tester; empty: without keys
  int priority = 60;           ///< SCHED_FIFO of the pinger and of receiving threads; 0: none
};

/// Sequence numbers of the pings to send, ascending; empty: all pings of the schedule.
using PingSelection = std::vector<std::uint32_t>;

/// Runs the test with the echoers at the other end of `control`. The calling thread gets real-time priority and keeps
/// it after the return. Throws LatencyError and WireError.
[[nodiscard]] Timestamps measure(const TestCase& test, ControlConnection& control, const SideSettings& side,
                                 const std::atomic<bool>& cancelled, const PingSelection& selection = {});

/// Runs the echoers of tests until the other side closes or `cancelled` is set. The pinger's side sets the domain, and
/// a priority of at most `side.priority`. Sends an error to the other side and throws it.
void serve(ControlConnection& control, const SideSettings& side, const std::atomic<bool>& cancelled);

}  // namespace tactus::latency
