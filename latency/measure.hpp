/// Measures one cell: the pinger's side here, the echoer's side at the other end of a Channel.
///
///     pinger                              echoer (as many as the cell has readers)
///     intended, sent ----- ping ----->    received           age = received - intended, by one clock
///     arrived       <----- echo ------    echoed             half round trip = (arrived - intended) / 2
///
/// Pings leave at the intended times of a fixed schedule. The measured time starts at the intended time even when a
/// ping leaves late, because the pinger woke up late or the previous ping was blocked. So there is no coordinated
/// omission.
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
  std::int64_t intended_ns = 0, sent_ns = 0;  ///< sent is 0 when the schedule ended first
  bool waited = false;                        ///< the pinger slept until the intended time and was not blocked
};
/// Arrival of a ping at an echoer; the echoer's clock.
struct Arrival {
  std::uint32_t sequence = 0, reader = 0;
  std::int64_t received_ns = 0;
};
struct Echo {
  std::uint32_t sequence = 0, reader = 0;
  std::int64_t received_ns = 0, echoed_ns = 0;  ///< the echoer's clock
  std::int64_t arrived_ns = 0;
};

/// All timestamps of a cell. Both lists in order of arrival, duplicates included.
struct Stamps {
  Cell cell;
  std::vector<Ping> pings;  ///< by sequence
  std::vector<Arrival> arrivals;
  std::vector<Echo> echoes;
  bool one_clock = false;          ///< both sides read the same clock
  std::uint64_t refused = 0;       ///< pings that the carrier refused
  double load_bytes_per_s = 0;     ///< received by the sink
  std::vector<std::string> notes;  ///< about real-time priority, of both sides
};

/// Settings of one side, not of a cell.
struct SideSettings {
  std::string echo_address = "127.0.0.1";  ///< of the echoers' machine, as seen from the pinger
  int domain = 20;
  wire::Discovery discovery;  ///< each side has its own; unused with raw-udp
  std::filesystem::path qos;
  int priority = 60;  ///< SCHED_FIFO of the pinger and of receiving threads; 0: none
};

/// The pings of a cell's schedule to send, ascending; empty: all.
using Plan = std::vector<std::uint32_t>;

/// Runs the cell with the echoer at the other end of `channel`. Leaves its thread at real-time priority. Throws
/// LatencyError and WireError.
[[nodiscard]] Stamps measure(const Cell& cell, Channel& channel, const SideSettings& side,
                             const std::atomic<bool>& stop, const Plan& plan = {});

/// Answers pingers until the other side closes or `stop` is set. `side.domain` and `side.priority` come from the
/// pinger. An error is sent to the other side and thrown.
void serve(Channel& channel, const SideSettings& side, const std::atomic<bool>& stop);

}  // namespace tactus::latency
