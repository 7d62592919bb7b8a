#include "spm/offline/snap.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>

#include "spm/position_code.hpp"

namespace tactus::spm::offline {
namespace {

struct Bounds {
  std::array<float, 3> low, high;
};

Bounds bounds_of(const TriangleMesh& mesh) {
  constexpr float kFar = std::numeric_limits<float>::infinity();
  Bounds bounds{{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
  for (const std::array<float, 3>& p : mesh.positions) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      bounds.low[axis] = std::min(bounds.low[axis], p[axis]);
      bounds.high[axis] = std::max(bounds.high[axis], p[axis]);
    }
  }
  return bounds;
}

}  // namespace

double step_of_grid(const TriangleMesh& mesh, unsigned bits) {
  const Bounds bounds = bounds_of(mesh);
  double side = 0, furthest = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    side = std::max(side, double{bounds.high[axis]} - double{bounds.low[axis]});
    furthest = std::max({furthest, std::abs(double{bounds.low[axis]}), std::abs(double{bounds.high[axis]})});
  }
  const double step = side / ((1u << bits) - 1);
  const double float_step = furthest * std::numeric_limits<float>::epsilon();
  if (!(step > float_step)) {
    std::ostringstream text;
    text << "grid of " << bits << " bits: its step would be " << step << ", expected above " << float_step
         << ", the distance of neighbouring floats this far from 0";
    throw ModelError{text.str()};
  }
  return step;
}

CleanReport snap(TriangleMesh& mesh, double step, unsigned threads) {
  CleanReport report;
  // Repeats, because cleaning may change the lower bounds, at which the grid begins.
  for (bool moved = true; moved && !mesh.positions.empty();) {
    ModelSummary summary{};
    summary.bounds_min = bounds_of(mesh).low;
    summary.position_step = step;
    const PositionCode grid{summary};
    moved = false;
    for (std::array<float, 3>& p : mesh.positions) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float before = std::exchange(p[axis], grid.decode(axis, grid.encode(axis, double{p[axis]})));
        moved = moved || p[axis] != before;
      }
    }
    report = report + clean(mesh, threads);
  }
  return report;
}

}  // namespace tactus::spm::offline
