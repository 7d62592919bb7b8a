/// Compares methods to simulate an object that several users hold over a network, in virtual time.
///
///     hand -- device -- touch --[spring]-- copy or delayed pose of the object ~~ network ~~ the other users
///
/// The same seed gives the same run. One thread.
#pragma once

#include <cstdint>

#include "haptics/coupling.hpp"
#include "netem/profile.hpp"

namespace tactus::study {

enum class Method {
  kChannel,  ///< wave-variable channels couple the copies (haptics/coupling.hpp)
  kSpring,   ///< a spring pulls each copy to the mean of the others' last positions, limited by an energy tank
  kNaive,    ///< as kSpring without an energy tank
  kServer    ///< one server simulates the object; all users touch the last received pose
};
inline constexpr const char* kMethodNames[]{"channel", "set position", "naive", "server"};

struct WorldSettings {
  Method method = Method::kChannel;
  std::size_t users = 2;
  double mass = 0.5;            ///< kg
  double coupling = 1000;       ///< stiffness between copies, N/m
  double coupling_damping = 3;  ///< damping between copies with kSpring and kNaive, N s/m
  double grip = 1000;           ///< stiffness between a device and the held object, N/m
  double grip_damping = 4;      ///< damping between a device and the held object, N s/m
  netem::LinkProfile link;      ///< each direction
  double playout = 0.03;        ///< playout delay of the channels, s
  std::uint64_t seed = 1;
  bool port_control = false;     ///< with a passivity controller at the port of each hand
  double disagreement = 0.0005;  ///< m, standard deviation of the hands' estimates of the object's position
};

struct CarryResult {
  double settling_time = 0;  ///< time from the end of the hands' motion until all points of copies are below 1 mm/s, s
  double end_copy_distance = 0;  ///< largest distance of corresponding corners of copies 1 s after the hands' motion, m
  double max_copy_distance = 0;  ///< largest distance of corresponding corners of copies in the whole run, m
  double injected = 0;       ///< maximum over time of the energy that all couplings gave minus what they received, J
  double limited_share = 0;  ///< share of cycles in which an energy tank limited a set position
  double peak_force = 0;     ///< on a hand, N
  double port_lowest = 0;    ///< minimum energy over all hands' ports, J; below 0: the port gave more than it received
  double tank_lowest = 0;    ///< minimum energy over all copies' energy tanks, J
  double withholding = 0;    ///< share of cycles in which a passivity controller reduced a force
  bool finite = true;        ///< false: the run diverged and ended early
  bool settles = true;       ///< finite, and no point of a copy is faster than 1 mm/s in the last second of the run
};
/// Runs users who grab the object and carry it along a path. Their hands stop at 6 s; the run ends at `seconds`.
[[nodiscard]] CarryResult carry(const WorldSettings& settings, double seconds);

struct MassResult {
  double mass = 0;     ///< force in phase with the acceleration, divided by the acceleration, kg
  double damping = 0;  ///< force in phase with the velocity, divided by the velocity, N s/m
};
/// Returns whether two copies come to rest after 0.2 s in which forces push them apart. No hand touches them.
[[nodiscard]] bool comes_to_rest(const WorldSettings& settings);

/// Measures the apparent mass of the object with a force of `frequency` (Hz) on one copy while no hand holds a copy.
[[nodiscard]] MassResult apparent_mass(const WorldSettings& settings, double frequency);

}  // namespace tactus::study
