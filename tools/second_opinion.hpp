/// FCL on the question that an audit answers by its own geometry: which triangles does a ball touch, and how far is the
/// nearest one?
///
/// FCL works in double precision and compares squares, so it is the weaker of the two: it is no judge, but where it
/// says otherwise by more than the tolerance, one of them is wrong. Model frame, file units. One thread at a time.
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
    std::vector<std::uint32_t> only_ours, only_fcl;  ///< touched triangles, those near tangency left out
    std::uint32_t tangent = 0;                       ///< triangles left out: one says so, their distance is the radius
    /// Of the nearest triangle, when the two differ; ours is none when no triangle is within the radius.
    struct Distance {
      std::optional<double> ours;
      double fcl;
    };
    std::optional<Distance> distance;

    [[nodiscard]] bool agrees() const noexcept { return only_ours.empty() && only_fcl.empty() && !distance; }
  };

  /// Borrows `triangles`: not empty. FCL's tree is built when it is first asked, O(n log n), some 300 bytes a triangle.
  explicit SecondOpinion(const std::vector<Corners>& triangles) : triangles_{triangles} {}

  /// What FCL has against `near`, which are all triangles not much further than `radius` from `centre`, ascending. A
  /// difference of up to `tolerance` is none; FCL's squares need about 1e-8 of the largest triangle.
  [[nodiscard]] Answer ask(const Point& centre, double radius, double tolerance,
                           const std::vector<SurfaceGrid::Near>& near);

 private:
  void build();

  const std::vector<Corners>& triangles_;
  std::optional<spm::fcl::FixedMesh> mesh_;
  std::vector<std::uint32_t> touching_;
};

}  // namespace tactus::tools
