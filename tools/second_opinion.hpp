/// FCL's answer to the question of an audit: which triangles does a sphere touch, and how far is the nearest one?
///
/// FCL computes squares in double precision, so it is less accurate than the audit and does not decide. But when they
/// differ by more than the tolerance, one of them is wrong. Model frame, file units. One thread at a time.
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
    std::vector<std::uint32_t> only_ours, only_fcl;  ///< touched triangles, without those near tangency
    std::uint32_t tangent = 0;  ///< triangles omitted: reported by only one, at a distance equal to the radius
    /// Distances of the nearest triangle if they differ; `ours` is empty when no triangle is within the radius.
    struct Distance {
      std::optional<double> ours;
      double fcl;
    };
    std::optional<Distance> distance;

    [[nodiscard]] bool agrees() const noexcept { return only_ours.empty() && only_fcl.empty() && !distance; }
  };

  /// Borrows `triangles`: not empty. Builds FCL's tree at the first query, O(n log n), about 300 bytes per triangle.
  explicit SecondOpinion(const std::vector<Corners>& triangles) : triangles_{triangles} {}

  /// Compares FCL with `near`, which must hold all triangles not much further than `radius` from `centre`, ascending.
  /// Differences up to `tolerance` are ignored; FCL's squares need about 1e-8 of the largest triangle.
  [[nodiscard]] Answer compare(const Point& centre, double radius, double tolerance,
                               const std::vector<SurfaceGrid::Near>& near);

 private:
  void build();

  const std::vector<Corners>& triangles_;
  std::optional<spm::fcl::FixedMesh> mesh_;
  std::vector<std::uint32_t> touching_;
};

}  // namespace tactus::tools
