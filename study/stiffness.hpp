/// The largest stiffness that stays stable, against the round trip, for each way to render contact; in virtual time.
#pragma once

namespace tactus::study {

/// N/m; kStiffest: that or more.
struct Stiffness {
  double wall_bound = 0;      ///< (b + B) / (T / 2 + td), analytic
  double wall = 0;            ///< a wall whose force comes late and is held last
  double wall_passivity = 0;  ///< the same with a passivity controller
  double copies_bound = 0;    ///< 0.8 x 2 B / (RTT + T), analytic
  double copies_naive = 0;    ///< two copies of a box, each pulled to where the other was last heard
  double copies_set = 0;      ///< the same by passive set-position modulation
  double copies_line = 0;     ///< on a passive line
};

inline constexpr double kStiffest = 20'000;  ///< N/m, of the search
inline constexpr double kDeviceMass = 0.2;   ///< kg, of device and hand
inline constexpr double kDeviceDamping = 5;  ///< N s/m, of both

/// At a round trip of so many seconds, by `steps` bisections of its logarithm. Takes seconds.
[[nodiscard]] Stiffness largest_stable(double round_trip, int steps);

}  // namespace tactus::study
