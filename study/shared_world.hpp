/// Users who hold one object over a network, in virtual time: the ways to simulate it, side by side.
///
///     hand -- device -- touch --[spring]-- copy or delayed picture of the object ~~ network ~~ the others
///
/// Same seed, same run. One thread.
#pragma once

#include <cstdint>

#include "haptics/coupling.hpp"
#include "netem/profile.hpp"

namespace tactus::study {

enum class Method {
  kLine,    ///< copies on a passive line (haptics/coupling.hpp)
  kSpring,  ///< copies, each pulled to where the others were last heard, by passive set-position modulation alone
  kNaive,   ///< the same without the tank
  kServer   ///< one simulator, everybody touches the last pose heard
};
inline constexpr const char* kMethodNames[]{"line", "set position", "naive", "server"};

struct WorldSettings {
  Method method = Method::kLine;
  std::size_t users = 2;
  double mass = 0.5;        ///< kg
  double coupling = 1000;   ///< N/m between copies
  double grip = 1000;       ///< N/m between a device and what it holds
  double grip_damping = 4;  ///< N s/m, of that
  netem::LinkProfile link;  ///< each way
  double playout = 0.03;    ///< s, the line's delay
  std::uint64_t seed = 1;
  bool port_control = false;     ///< a passivity controller between each touch and its hand
  double disagreement = 0.0005;  ///< m, standard deviation of where the hands think the object is
};

struct CarryResult {
  double settled = 0;       ///< s after the users' rest at which the last point of a copy was faster than 1 mm/s
  double apart = 0;         ///< m, between corners of copies, 1 s after the rest
  double apart_moving = 0;  ///< m, at most
  double injected = 0;      ///< J that all couplings together gave beyond what they had taken, at most
  double held = 0;          ///< share of cycles in which a tank held a set position back
  double peak_force = 0;    ///< N, on a hand
  double port_lowest = 0;   ///< J, of the energy of any hand's port
  double tank_lowest = 0;   ///< J, of any copy's tank
  double withholding = 0;   ///< share of cycles in which a port's force was held back
  bool finite = true;
};
/// The users grab the object, carry it along a path of some 6 s, and rest until `seconds`.
[[nodiscard]] CarryResult carry(const WorldSettings& settings, double seconds);

struct MassResult {
  double mass = 0;     ///< kg, in phase with the acceleration
  double damping = 0;  ///< N s/m, in phase with the velocity
};
/// Whether two copies, pushed apart for 0.2 s without any hand, come to rest.
[[nodiscard]] bool settles(const WorldSettings& settings);

/// What the object weighs to a force of `frequency` on one copy while nobody holds the others.
[[nodiscard]] MassResult apparent_mass(const WorldSettings& settings, double frequency);

}  // namespace tactus::study
