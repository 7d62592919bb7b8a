/// Computes the path of a tip that follows a surface, and writes recordings for `tactus-hrtc --replay`.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <stdexcept>
#include <vector>

#include "bench/models.hpp"
#include "bench/surface_path.hpp"
#include "spm/fcl/fixed_mesh.hpp"

namespace tactus::bench {

inline constexpr double kRecordingPeriod = 0.001;  ///< time between two positions of `follow_surface`, s

/// Returns 30,000 positions of a tip of 3 mm that follows the surface at `speed`, m/s. World frame, metres, the object
/// at the origin.
[[nodiscard]] inline std::vector<spm::Vec3d> follow_surface(const LoadedModel& subject, double speed) {
  constexpr double kRadius = 0.003;  // of the tip, m
  constexpr double kDepth = 0.0003;  // of the tip in the surface, m
  constexpr std::uint32_t kPositions = 30'000, kSeed = 1;
  const double unit = subject.model.summary.metres_per_unit;
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  const PathSettings settings{kRadius / unit, kDepth / unit, speed * kRecordingPeriod / unit, kPositions, kSeed};
  std::vector<spm::Vec3d> path = surface_path(subject.model.positions, subject.finest, settings,
                                              [&](const spm::Vec3d& p) { return finest.distance(p); });
  for (spm::Vec3d& at : path) at *= unit;
  return path;
}

/// Writes the recording of a tip that is at `positions` (m), one after the other, `interval` s apart. Throws
/// std::runtime_error.
inline void write_recording(const std::filesystem::path& file, std::span<const spm::Vec3d> positions, double interval) {
  std::ofstream out{file};
  out.precision(9);
  double time = 0;
  for (const spm::Vec3d& at : positions) {
    out << time << ',' << at[0] << ',' << at[1] << ',' << at[2] << '\n';
    time += interval;
  }
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

}  // namespace tactus::bench
