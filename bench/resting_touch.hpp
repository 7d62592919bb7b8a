/// Writes the recording of a tip that comes down on a model and rests there.
#pragma once

#include <algorithm>
#include <cstdio>
#include <string>

#include "bench/models.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {

/// Writes the recording of a tip that comes down on the highest vertex of the model and rests there. All users of
/// this recording need the same mesh to the bit. Simulated hands would rest at different points, because of friction
/// and tremor.
inline void write_resting_touch(const std::string& model, const std::string& file) {
  constexpr double kTipRadius = 0.003;   // m, the default of tactus-hrtc
  constexpr double kDepth = 0.0002;      // m
  constexpr double kStartHeight = 0.01;  // m above the point of contact
  const LoadedModel loaded = load_model(model, 0);
  const double unit = loaded.model.summary.metres_per_unit;
  const auto top = std::max_element(loaded.model.positions.begin(), loaded.model.positions.end(),
                                    [](const auto& a, const auto& b) { return a[2] < b[2]; });
  const double x = (*top)[0] * unit, y = (*top)[1] * unit, z = (*top)[2] * unit + kTipRadius - kDepth;
  char rows[200];
  std::snprintf(rows, sizeof rows, "0,%.9f,%.9f,%.9f\n0.5,%.9f,%.9f,%.9f\n", x, y, z + kStartHeight, x, y, z);
  test_support::write_bytes(file, rows);
}

}  // namespace tactus::bench
