/// A quadric: a weighted sum of squared distances to planes, as a function of a position. Positions are relative to the
/// quadric's own origin: near it, the numbers are small, so single precision is enough.
/// Source: Garland, Heckbert 1997.
#pragma once

#include <array>

namespace tactus::spm::offline {

using Offset = std::array<float, 3>;

[[nodiscard]] inline Offset between(const Offset& from, const Offset& to) {
  return {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
}

struct Quadric {
  float xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;  // coefficients of the quadratic terms
  float x = 0, y = 0, z = 0;                             // half of the coefficients of the linear terms
  float constant = 0;

  /// Adds a plane through the origin with unit normal n.
  void add_plane(const Offset& n, float weight) {
    xx += weight * n[0] * n[0];
    xy += weight * n[0] * n[1];
    xz += weight * n[0] * n[2];
    yy += weight * n[1] * n[1];
    yz += weight * n[1] * n[2];
    zz += weight * n[2] * n[2];
  }
  /// The value at p.
  [[nodiscard]] float at(const Offset& p) const {
    return p[0] * (xx * p[0] + 2 * (xy * p[1] + xz * p[2] + x)) + p[1] * (yy * p[1] + 2 * (yz * p[2] + y)) +
           p[2] * (zz * p[2] + 2 * z) + constant;
  }
  /// Adds a quadric with another origin. `to_here`: vector from the other origin to this one.
  void add(const Quadric& other, const Offset& to_here) {
    constant += other.at(to_here);
    x += other.x + (other.xx * to_here[0] + other.xy * to_here[1] + other.xz * to_here[2]);
    y += other.y + (other.xy * to_here[0] + other.yy * to_here[1] + other.yz * to_here[2]);
    z += other.z + (other.xz * to_here[0] + other.yz * to_here[1] + other.zz * to_here[2]);
    xx += other.xx;
    xy += other.xy;
    xz += other.xz;
    yy += other.yy;
    yz += other.yz;
    zz += other.zz;
  }
};

}  // namespace tactus::spm::offline
