/// Searches the largest stable stiffness at a round trip, for each method of rendering contact, in virtual time.
#pragma once

namespace tactus::study {

/// Largest stable stiffness, N/m. A value of kMaxStiffness means that the search found no limit.
///
/// Symbols of the analytic bounds: b is the damping of device and hand, B the virtual damping of the wall (0 here) or
/// of the coupling between the copies (3 N s/m). T is the cycle of 1 ms, RTT the round trip, and td = RTT the further
/// delay of the loop.
struct Stiffness {
  double wall_bound = 0;      ///< of a wall, analytic: (b + B) / (T / 2 + td)
  double wall = 0;            ///< of a wall whose force is delayed and held for a cycle
  double wall_passivity = 0;  ///< of this wall with a passivity controller
  double copies_bound = 0;    ///< of two copies, analytic: 0.8 x 2 B / (RTT + T)
  double copies_naive = 0;    ///< of two copies of a box; a spring pulls each to the other's last received position
  double copies_set = 0;      ///< of the same copies with an energy tank (passive set-position modulation)
  double copies_channel = 0;  ///< of two copies that a wave-variable channel couples
};

inline constexpr double kMaxStiffness = 20'000;  ///< N/m, largest stiffness of the search
inline constexpr double kDeviceMass = 0.2;       ///< kg, of device and hand together
inline constexpr double kDeviceDamping = 5;      ///< N s/m, of device and hand together

/// Searches by `steps` bisections of the logarithm of the stiffness. `round_trip` is in s. Takes seconds.
[[nodiscard]] Stiffness largest_stable_stiffness(double round_trip, int steps);

}  // namespace tactus::study
