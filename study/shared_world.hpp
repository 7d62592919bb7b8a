/// Users who hold one object over a network, in virtual time: a comparison of simulation methods.
///
///     hand -- device -- touch --[spring]-- copy or delayed pose of the object ~~ network ~~ the others
///
/// The same seed gives the same run. One thread.
#pragma once

#include <cstdint>

#include "haptics/coupling.hpp"
#include "netem/profile.hpp"

namespace tactus::study {

enum class Method {
  kChannel,  ///< copies coupled by wave-variable channels (haptics/coupling.hpp)
  kSpring,   ///< copies, each pulled to the others' last received positions by passive set-position modulation
  kNaive,    ///< the same without a tank
  kServer    ///< one simulator; all users touch its last received pose
};
inline constexpr const char* kMethodNames[]{"channel", "set position", "naive", "server"};

struct WorldSettings {
  Method method = Method::kChannel;
  std::size_t users = 2;
  double mass = 0.5;            ///< kg
  double coupling = 1000;       ///< N/m between copies
  double coupling_damping = 3;  ///< N s/m, likewise, of kSpring and kNaive; channels have their own
  double grip = 1000;           ///< N/m between a device and the held object
  double grip_damping = 4;      ///< N s/m, likewise
  netem::LinkProfile link;      ///< each direction
  double playout = 0.03;        ///< s, delay of the channel
  std::uint64_t seed = 1;
  bool port_control = false;     ///< a passivity controller at the port of each hand
  double disagreement = 0.0005;  ///< m, standard deviation of the object's position as assumed by the hands
};

struct CarryResult {
  double settled = 0;       ///< s from the end of the users' motion until no point of a copy is faster than 1 mm/s
  double apart = 0;         ///< m, between corners of copies, 1 s after the end of the motion
  double apart_moving = 0;  ///< m, maximum
  double injected = 0;      ///< J, maximum energy that all couplings gave minus what they took
  double held = 0;          ///< share of cycles in which a tank limited a set position
  double peak_force = 0;    ///< N, on a hand
  double port_lowest = 0;   ///< J, of the energy of any hand's port
  double tank_lowest = 0;   ///< J, of any copy's tank
  double withholding = 0;   ///< share of cycles in which a port reduced a force
  bool finite = true;
};
/// The users grab the object, carry it along a path of about 6 s, and then rest until `seconds`.
[[nodiscard]] CarryResult carry(const WorldSettings& settings, double seconds);

struct MassResult {
  double mass = 0;     ///< kg, in phase with the acceleration
  double damping = 0;  ///< N s/m, in phase with the velocity
};
/// True when two copies, pushed apart for 0.2 s without any hand, come to rest.
[[nodiscard]] bool comes_to_rest(const WorldSettings& settings);

/// Apparent mass of the object for a force of `frequency` on one copy while nobody holds the others.
[[nodiscard]] MassResult apparent_mass(const WorldSettings& settings, double frequency);

}  // namespace tactus::study
