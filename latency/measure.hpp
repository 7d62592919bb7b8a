/// One cell measured: the pinger's side here, the echoer's side at the other end of a Channel.
///
///     pinger                              echoer (as many as the cell has readers)
///     intended, sent ----- ping ----->    received           age = received - intended, by one clock
///     arrived       <----- echo ------    echoed             half round trip = (arrived - intended) / 2
///
/// Pings leave at the intended times of a fixed schedule. When one leaves late, because the system woke the pinger late
/// or because the one before it was held up, its time still counts from when it was intended: no omission is hidden.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "latency/cell.hpp"
#include "latency/channel.hpp"
#include "wire/participants.hpp"

namespace tactus::latency {

struct Ping {
  std::int64_t intended_ns = 0, sent_ns = 0;  ///< sent is 0 when it never was: the schedule ended first
  bool waited = false;                        ///< the pinger was asleep until then, not held up
};
/// A ping at an echoer; the echoer's clock.
struct Arrival {
  std::uint32_t sequence = 0, reader = 0;
  std::int64_t received_ns = 0;
};
struct Echo {
  std::uint32_t sequence = 0, reader = 0;
  std::int64_t received_ns = 0, echoed_ns = 0;  ///< the echoer's clock
  std::int64_t arrived_ns = 0;
};

/// All that was stamped. Both lists in order of arrival, duplicates included.
struct Stamps {
  Cell cell;
  std::vector<Ping> pings;  ///< by sequence
  std::vector<Arrival> arrivals;
  std::vector<Echo> echoes;
  bool one_clock = false;          ///< both sides read the same clock
  std::uint64_t refused = 0;       ///< pings that the carrier did not take
  double load_bytes_per_s = 0;     ///< that the sink got
  std::vector<std::string> notes;  ///< about real-time priority, of both sides
};

/// Settings of a program, not of a cell.
struct Place {
  std::string echo_address = "127.0.0.1";  ///< of the echoers' machine, as the pinger sees it
  int domain = 20;
  wire::Discovery discovery;  ///< each side has its own; not used by raw-udp
  std::filesystem::path qos;
  int priority = 60;  ///< SCHED_FIFO of the pinger and of receiving threads, 0: none
};

/// Which pings of a cell's schedule are sent, ascending, as a coder leaves some out; empty: all.
using Plan = std::vector<std::uint32_t>;

/// Runs the cell with the echoer at the other end of `channel`. Leaves its thread at real-time priority. Throws
/// LatencyError and WireError.
[[nodiscard]] Stamps measure(const Cell& cell, Channel& channel, const Place& place, const std::atomic<bool>& stop,
                             const Plan& plan = {});

/// Answers pingers until the other end closes or `stop` is set. `place.domain` and `place.priority` come from the
/// pinger. An error is told to the other end and thrown.
void serve(Channel& channel, const Place& place, const std::atomic<bool>& stop);

}  // namespace tactus::latency
