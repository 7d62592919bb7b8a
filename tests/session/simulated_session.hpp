/// A session of two hosts, three HRTCs and two clients in one thread and in virtual time, by a seed.
///
/// The programs are DeliveryServer, DeliveryClient, Roster, Vigil, SessionClock and UserSlots as they are; the network,
/// the cache of an HRTC and the hands of users are models. Users wander over two objects (both hosts serve the first,
/// one of them the second) while faults come as the schedule says; then all faults stop and the session has to heal:
///
///     what an HRTC takes into `have` decodes, is the model's and is closed          at all times
///     no message counts on a region that was released before                        at all times
///     nothing comes again, or incomplete, unless something was lost                 at all times
///     a clock is right to its stated bound and never steps back                     at all times
///     credit, incomplete messages and demands stay within their bounds              at all times
///     an HRTC that counts on a host notices its silence within 250 ms               at all times
///     each HRTC holds what it wants; rosters, slots and the keeper of time agree;   within kHealNs of the last fault
///     clocks are good to kClockNs; then no record is sent any more
///
/// Same seed, same run.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tests/session/simulated_controller.hpp"
#include "tests/session/simulated_network.hpp"

namespace tactus::test_support {

inline constexpr std::int64_t kHealNs = 2'000'000'000;
inline constexpr std::int64_t kClockNs = 100'000'000;

/// Something that happens to programs at a moment of the wandering.
struct PlannedFault {
  FaultKind kind = FaultKind::kRestart;  ///< kCrash, kRestart or kPartition
  std::int64_t at_ns = 0;
  std::int64_t lasts_ns = 0;   ///< no longer than the wandering does, but for those who are gone for good
  std::uint32_t programs = 0;  ///< bit by place: those that end, or those cut off from the others
  bool one_way = false;        ///< of a partition: they hear the others, but are not heard
  bool with_a_word = false;    ///< of a restart: says that it leaves
  bool for_good = false;       ///< of a crash
};

struct Schedule {
  std::int64_t wander_ns = 800'000'000;
  std::int64_t delay_ns = 1'000'000;  ///< of the network, one way
  SimulatedNetwork::Carrier carrier = SimulatedNetwork::Carrier::kLossy;
  NetworkFaults network;
  ControllerFaults controllers;
  std::vector<PlannedFault> planned;
  Sabotage sabotage = Sabotage::kNone;

  /// One line.
  [[nodiscard]] std::string text() const;
};

/// At least three kinds of fault.
[[nodiscard]] Schedule random_schedule(std::uint64_t seed);

struct SimulationResult {
  std::vector<std::string> broken;  ///< in words; empty: all holds
  std::uint64_t messages = 0;       ///< samples sent
  std::array<std::uint64_t, kFaultKinds> faults{};
  std::int64_t healed_ns = 0;  ///< since the last fault
  std::int64_t virtual_ns = 0;
  std::uint64_t chunks = 0;
  std::uint64_t host_changes = 0;
  ControllerFigures controllers;  ///< of all, and all their incarnations

  [[nodiscard]] std::size_t kinds() const;
};

/// `trace` gets a line for each sample and event; null: none.
[[nodiscard]] SimulationResult simulate(std::uint64_t seed, const Schedule& schedule,
                                        const std::function<void(const std::string&)>& trace = {});

}  // namespace tactus::test_support
