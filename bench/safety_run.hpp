/// The way from a remote device's bytes to the force, under everything a network and a broken device can do to it.
///
///   hand -> bytes -> lost, late, doubled, flipped, cut, extreme -> decode -> check -> RemoteDevice -> Proxy -> force
///
/// The same code as in an HRTC, in virtual time and one thread. The watcher that judges the force knows nothing of how
/// it was made: it has the limits, and when the last sample that was taken arrived.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "haptics/force.hpp"

namespace tactus::bench {

struct SafetySettings {
  std::uint64_t samples = 1'000'000;  ///< that arrive, in whatever state
  std::uint64_t seed = 1;
  haptics::ForceSettings force;
  /// Of samples that the check refuses, the share that is handed on as if nothing had checked them.
  double unchecked = 0.1;
};

struct SafetyResult {
  std::uint64_t arrived = 0, undecodable = 0, refused = 0, overtaken = 0, taken = 0, unchecked = 0;
  std::uint64_t corrupted = 0, late = 0, doubled = 0, lost = 0;  // at the sender
  std::uint64_t cycles = 0, contact_cycles = 0, force_cycles = 0;
  std::array<std::uint64_t, haptics::kForceBits> interventions{};  ///< times begun
  std::array<std::uint64_t, 16> faults{};                          ///< latched, by haptics::Fault
  std::uint64_t torque_cycles = 0;
  double largest_force = 0, largest_step = 0;          ///< N; N in a cycle while nothing was latched
  double largest_torque = 0, largest_torque_step = 0;  ///< the same, N m
  double oldest_force = 0;                             ///< s of silence with a force
  std::uint64_t over_limit = 0, over_slew = 0, not_finite = 0, too_old = 0, too_soon = 0, despite_fault = 0,
                without_reason = 0, ended_by_itself = 0;
  std::vector<std::string> problems;  ///< the first few, with seed and cycle

  [[nodiscard]] std::uint64_t violations() const noexcept {
    return over_limit + over_slew + not_finite + too_old + too_soon + despite_fault + without_reason + ended_by_itself;
  }
};

[[nodiscard]] SafetyResult run_safety(const SafetySettings& settings);

}  // namespace tactus::bench
