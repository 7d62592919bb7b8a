/// The stylus in a model's file units, and its poses on a surface path. The shaft points along the smoothed normal of
/// the surface.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "bench/surface_path.hpp"
#include "spm/offline/generate.hpp"
#include "spm/rotation.hpp"

namespace tactus::bench {

/// Returns the stylus in units of `unit` metres.
[[nodiscard]] inline spm::offline::TriangleMesh stylus_in(double unit) {
  spm::offline::TriangleMesh mesh = spm::offline::stylus();
  for (std::array<float, 3>& p : mesh.positions)
    for (float& x : p) x = static_cast<float>(x / unit);
  return mesh;
}

/// Returns poses with the tip on the path. The shaft may pass through the model.
[[nodiscard]] inline std::vector<Eigen::Isometry3d> stylus_poses(const std::vector<SurfacePose>& path) {
  std::vector<Eigen::Isometry3d> poses;
  for (const SurfacePose& pose : path) {
    Eigen::Isometry3d at = Eigen::Isometry3d::Identity();
    at.linear() = spm::rotation_between(spm::Vec3d::UnitZ(), pose.normal).toRotationMatrix();
    at.translation() = pose.centre;
    poses.push_back(at);
  }
  return poses;
}

}  // namespace tactus::bench
