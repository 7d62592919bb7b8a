/// Rotations, compiled once: Eigen computes them with a singular value decomposition, which takes a compiler 8 s in
/// every file that contains it.
#pragma once

#include <Eigen/Geometry>

namespace tactus::spm {

/// Returns the smallest rotation that turns the direction of `from` into that of `to`. Both must be longer than 0. If
/// they are opposite, returns one of the half turns.
[[nodiscard]] Eigen::Quaterniond rotation_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to) noexcept;

}  // namespace tactus::spm
