/// Checks the forces for a remote device whose samples are lost, late, repeated or corrupted.
///
///   hand -> bytes -> lost, late, repeated, corrupted -> decode -> check -> RemoteDevice -> Proxy -> force
///
/// Runs the code of an HRTC in virtual time and one thread. The checker of the forces has only these inputs: the
/// forces, their faults, the limits, and the time at which the last accepted sample arrived.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "haptics/force.hpp"

namespace tactus::bench {

struct SafetySettings {
  std::uint64_t samples = 1'000'000;  ///< number of samples that arrive
  std::uint64_t seed = 1;
  haptics::ForceSettings force;
  /// Share of the refused samples that reach the RemoteDevice nevertheless.
  double unchecked = 0.1;
};

/// Counts and extremes of all cycles, of the sphere and of the tool.
struct SafetyResult {
  std::uint64_t sent = 0, corrupted = 0, late = 0, repeated = 0, lost = 0;  ///< number of samples, by the channel
  std::uint64_t arrived = 0, undecodable = 0, refused = 0;                  ///< number of samples
  std::uint64_t unchecked = 0;                                              ///< number of refused samples passed on
  std::uint64_t overtaken = 0, accepted = 0;  ///< number of samples, by their sequence numbers
  std::uint64_t cycles = 0, contact_cycles = 0;
  std::uint64_t force_cycles = 0, torque_cycles = 0;               ///< number of forces and torques, of sphere and tool
  std::array<std::uint64_t, haptics::kForceBits> interventions{};  ///< number of times that each began
  std::array<std::uint64_t, 16> faults{};                          ///< number of latched faults, by haptics::Fault
  double max_force = 0, max_torque = 0;                            ///< N; N m
  double max_force_step = 0, max_torque_step = 0;                  ///< change in a cycle without a fault, N; N m
  double max_silence = 0;  ///< time without an accepted sample at which a force still acted, s
  // Numbers of forces and torques that broke a limit. `too_old`: acts on a pose that is too old. `too_soon`: is above
  // the soft start. `without_reason`: is zero by a fault without a reason. `ended_by_itself`: the fault ended without
  // a reset.
  std::uint64_t over_limit = 0, over_slew = 0, not_finite = 0, too_old = 0, too_soon = 0, despite_fault = 0,
                without_reason = 0, ended_by_itself = 0;
  std::vector<std::string> problems;  ///< first violations, with seed and cycle

  [[nodiscard]] std::uint64_t violations() const noexcept {
    return over_limit + over_slew + not_finite + too_old + too_soon + despite_fault + without_reason + ended_by_itself;
  }
};

/// Runs until `settings.samples` samples have arrived. The same settings give the same result.
[[nodiscard]] SafetyResult run_safety(const SafetySettings& settings);

}  // namespace tactus::bench
