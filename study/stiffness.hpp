/// The largest stable stiffness over the round trip, for each method of rendering contact; in virtual time.
#pragma once

namespace tactus::study {

/// N/m; kStiffest: that or more.
struct Stiffness {
  double wall_bound = 0;      ///< (b + B) / (T / 2 + td), analytic
  double wall = 0;            ///< a wall whose force is delayed and held
  double wall_passivity = 0;  ///< the same with a passivity controller
  double copies_bound = 0;    ///< 0.8 x 2 B / (RTT + T), analytic
  double copies_naive = 0;    ///< two copies of a box, each pulled to the other's last received position
  double copies_set = 0;      ///< the same with passive set-position modulation
  double copies_channel = 0;  ///< coupled by a wave-variable channel
};

inline constexpr double kStiffest = 20'000;  ///< N/m, of the search
inline constexpr double kDeviceMass = 0.2;   ///< kg, of device and hand
inline constexpr double kDeviceDamping = 5;  ///< N s/m, of both

/// For a round trip in s, by `steps` bisections of the logarithm. Takes seconds.
[[nodiscard]] Stiffness largest_stable(double round_trip, int steps);

}  // namespace tactus::study
