/// A session of two hosts, three HRTCs and two clients in one thread and in virtual time, by a seed.
///
/// DeliveryServer, DeliveryClient, Roster, FailureDetector, SessionClock and UserSlots are the real ones; the network,
/// the cache of an HRTC and the hands of users are models. Users move over two objects (both hosts serve the first, one
/// of them the second) while the schedule causes faults. Then all faults end and the session has to recover:
///
///     a region in `have` decodes, equals the model's and is closed                  at all times
///     no message relies on a region that was released before                        at all times
///     no record comes again, and no region incomplete, unless something was lost    at all times
///     a clock's error is within its stated bound, and it never steps back           at all times
///     credit, incomplete messages and demands stay within their bounds              at all times
///     an HRTC detects the silence of a host that it needs within 250 ms             at all times
///     each HRTC holds what it wants; rosters, slots and time references agree;      within kHealNs of the last fault
///     clock bounds are below kClockNs; then no record is sent any more
///
/// The same seed gives the same run.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tests/session/simulated_hrtc.hpp"
#include "tests/session/simulated_network.hpp"

namespace tactus::test_support {

inline constexpr std::int64_t kHealNs = 2'000'000'000;
inline constexpr std::int64_t kClockNs = 100'000'000;

/// A fault of some programs at one time.
struct PlannedFault {
  FaultKind kind = FaultKind::kRestart;  ///< kCrash, kRestart or kPartition
  std::int64_t at_ns = 0;
  std::int64_t lasts_ns = 0;         ///< ends with the faulty phase at the latest, unless `for_good`
  std::uint32_t programs = 0;        ///< bits by index: programs that end, or that are cut off from the others
  bool one_way = false;              ///< of a partition: they receive from the others, but cannot send to them
  bool sends_leave_message = false;  ///< of a restart: sends a leave message
  bool for_good = false;             ///< of a crash: no restart
};

struct Schedule {
  std::int64_t wander_ns = 800'000'000;
  std::int64_t delay_ns = 1'000'000;  ///< of the network, one way
  SimulatedNetwork::Carrier carrier = SimulatedNetwork::Carrier::kLossy;
  NetworkFaults network;
  HrtcFaults hrtcs;
  std::vector<PlannedFault> planned;
  Sabotage sabotage = Sabotage::kNone;

  /// One line.
  [[nodiscard]] std::string text() const;
};

/// With at least three kinds of fault.
[[nodiscard]] Schedule random_schedule(std::uint64_t seed);

struct SimulationResult {
  std::vector<std::string> broken;  ///< violated invariants, as text
  std::uint64_t messages = 0;       ///< samples sent
  std::array<std::uint64_t, kFaultKinds> faults{};
  std::int64_t healed_ns = 0;  ///< since the last fault
  std::int64_t virtual_ns = 0;
  std::uint64_t chunks = 0;
  std::uint64_t host_changes = 0;
  HrtcFigures hrtcs;  ///< summed over all HRTCs and their incarnations

  [[nodiscard]] std::size_t kinds() const;
};

/// `trace` receives a line for each sample and event; may be null.
[[nodiscard]] SimulationResult simulate(std::uint64_t seed, const Schedule& schedule,
                                        const std::function<void(const std::string&)>& trace = {});

}  // namespace tactus::test_support
