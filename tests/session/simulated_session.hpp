/// A session of two hosts, three HRTCs and two clients in one thread and in virtual time.
///
/// DeliveryServer, DeliveryClient, Roster, FailureDetector, SessionClock and UserTable are the production classes. The
/// network, the cache of an HRTC and the hands of users are models. Users move over two objects while the schedule
/// causes faults. Both hosts serve the first object, one of them also the second. Then all faults of the network end
/// and all programs run again, and the session has to recover. The delays of HRTCs continue. Invariants:
///
///     at all times
///       - Each region that a demand lists as present is decoded, equals the region of the model, and all its records
///         are held.
///       - No message relies on a region that was released before.
///       - No page of the directory is requested or received while it is held.
///       - Unless an answer was postponed or a fault occurred in the last 1.5 s, no record of a region that was never
///         retired is received again, and no region is received without a record that it needs.
///       - Once the reference has answered, the error of a clock is within its stated bound, and a clock
///         steps back only when sessions merge.
///       - Credit, incomplete messages and demands stay within their bounds.
///       - An HRTC suspects a host that it needs after at most 258 ms of silence: the max
///         timeout and four ticks of 2 ms.
///     at most kMaxRecoveryNs after the end of the faulty phase
///       - Each HRTC holds the regions and pages that it wants of objects that a running host serves. Rosters and
///         served users agree, and each time reference runs.
///       - The error bounds of the clocks are below kMaxClockBoundNs.
///       - After the recovery and the last demand, hosts send no more records.
///
/// The same seed and schedule give the same run.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tests/session/simulated_hrtc.hpp"
#include "tests/session/simulated_network.hpp"

namespace tactus::test_support {

inline constexpr std::int64_t kMaxRecoveryNs = 2'000'000'000;
inline constexpr std::int64_t kMaxClockBoundNs = 100'000'000;

/// A fault of one or several programs, planned for a given time.
struct PlannedFault {
  FaultKind kind = FaultKind::kRestart;  ///< kCrash, kRestart or kPartition
  std::int64_t at_ns = 0;
  /// Time until the restart or the end of the cut; ends with the faulty phase at the latest.
  std::int64_t duration_ns = 0;
  /// Bit mask of the programs that stop or are cut off. Bit i is program i: hosts first, then HRTCs, then clients.
  std::uint32_t programs = 0;
  bool one_way = false;              ///< of a partition: the programs still receive from the others
  bool sends_leave_message = false;  ///< of a restart
  bool permanent = false;            ///< of a crash: no restart
};

struct Schedule {
  std::int64_t faulty_phase_ns = 800'000'000;  ///< time in which users move and faults happen
  std::int64_t delay_ns = 1'000'000;           ///< of the network, one way
  SimulatedNetwork::Reliability reliability = SimulatedNetwork::Reliability::kBestEffort;
  NetworkFaults network_faults;
  HrtcFaults hrtc_faults;
  std::vector<PlannedFault> planned_faults;
  InjectedBug bug = InjectedBug::kNone;

  /// Describes the schedule in one line.
  [[nodiscard]] std::string text() const;
};

/// Returns a schedule with at least three kinds of fault.
[[nodiscard]] Schedule random_schedule(std::uint64_t seed);

struct SimulationResult {
  std::vector<std::string> violations;  ///< violated invariants, as text
  std::uint64_t samples_sent = 0;
  /// By FaultKind: number of samples affected, or of programs stopped.
  std::array<std::uint64_t, kFaultKinds> fault_counts{};
  /// Time from the end of the faulty phase to the first check that the session passes; none if it passes no check.
  std::optional<std::int64_t> recovery_ns;
  std::int64_t virtual_ns = 0;
  std::uint64_t chunks = 0;
  std::uint64_t host_changes = 0;  ///< of serving hosts, in the last incarnation of each HRTC
  HrtcFigures hrtcs;               ///< sums over all HRTCs and their incarnations, and the max of `max_detection_ns`

  /// Number of kinds of fault that happened.
  [[nodiscard]] std::size_t fault_kinds() const;
};

/// Runs one session. `trace` receives a line for each sample and event; may be null.
[[nodiscard]] SimulationResult simulate(std::uint64_t seed, const Schedule& schedule,
                                        const std::function<void(const std::string&)>& trace = {});

}  // namespace tactus::test_support
