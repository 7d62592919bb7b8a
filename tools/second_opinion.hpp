/// Compares an audit with FCL: the triangles that a sphere touches, and the distance of the nearest triangle.
///
/// FCL computes squares in double precision, so it is less accurate than the audit. If FCL and the audit differ by more
/// than the tolerance, one of the two is wrong. Model frame, file units. One thread at a time.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "spm/fcl/fixed_mesh.hpp"
#include "tools/surface_grid.hpp"

namespace tactus::tools {

class SecondOpinion {
 public:
  struct Answer {
    std::vector<std::uint32_t> only_audit, only_fcl;  ///< triangles that only the audit, or only FCL, touches
    std::uint32_t tangent =
        0;  ///< triangles omitted from both lists, as their distance equals the radius within the tolerance
    /// Distances of the nearest triangle. `ours` is the audit's distance; empty if no triangle is within the radius.
    struct Distance {
      std::optional<double> ours;
      double fcl;
    };
    std::optional<Distance> distance;  ///< empty if the two distances agree

    [[nodiscard]] bool agrees() const noexcept { return only_audit.empty() && only_fcl.empty() && !distance; }
  };

  /// `triangles` must not be empty and must outlive this. The first query builds FCL's tree in O(n log n), with about
  /// 300 bytes per triangle.
  explicit SecondOpinion(const std::vector<Corners>& triangles) : triangles_{triangles} {}

  /// Compares FCL with `near`, which must hold all triangles within `radius` of `centre` in ascending order, and may
  /// hold more. Ignores differences up to `tolerance`, which must be at least 1e-8 of the size of the largest triangle.
  [[nodiscard]] Answer compare(const Point& centre, double radius, double tolerance,
                               const std::vector<SurfaceGrid::Near>& near);

 private:
  void build();

  const std::vector<Corners>& triangles_;
  std::optional<spm::fcl::FixedMesh> mesh_;
  std::vector<std::uint32_t> touching_;
};

}  // namespace tactus::tools
