/// The complete finest mesh of a model as a surface, the reference for a proxy on a refined mesh.
///
/// It finds faces by a uniform grid, without the tree, forest, pool and refinement of an HRTC. Arguments and results
/// are in the world frame. Allocates.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "haptics/surface.hpp"
#include "hrtc_service/servo/touch_object.hpp"

namespace tactus::study {

class FullMesh final : public haptics::Surface {
 public:
  /// The index in `faces` is the FaceId. `cell_size` is the edge of a grid cell, m; queries are fastest if it is about
  /// the radius of the probe's sphere. The arrays of the spans must outlive this.
  FullMesh(std::span<const std::array<float, 3>> vertices, std::span<const std::array<std::uint32_t, 3>> faces,
           const hrtc_service::Placement& placement, double cell_size);

  [[nodiscard]] bool sweep(const spm::Vec3d& from, const spm::Vec3d& to, double radius,
                           haptics::SurfaceHit& hit) noexcept override;
  [[nodiscard]] bool closest(const spm::Vec3d& point, double within, haptics::SurfaceHit& hit) const noexcept override;

 private:
  using GridCell = std::array<std::int32_t, 3>;
  struct Entry {
    std::uint32_t face;
    spm::CellBox box;
  };
  struct Corners {
    spm::Vec3d a, b, c;
  };

  [[nodiscard]] GridCell cell_of(const spm::Vec3d& p) const noexcept;
  /// Calls `visit(entry)` once for each face whose box is within `reach` of `middle`, both in the model frame. `visit`
  /// may reduce `reach`.
  template <class Visit>
  void for_each_near(const spm::Vec3d& middle, const double& reach, Visit&& visit) const noexcept;
  [[nodiscard]] spm::CellBox box_of(std::uint32_t face) const noexcept;
  [[nodiscard]] Corners corners(std::uint32_t face) const noexcept;

  hrtc_service::Placement placement_;
  std::span<const std::array<float, 3>> vertices_;
  std::span<const std::array<std::uint32_t, 3>> faces_;
  double cell_size_;  // model frame
  spm::Vec3d origin_;
  GridCell size_{};                    // number of cells along each axis
  std::vector<std::uint32_t> starts_;  // by cell: index of its first entry
  std::vector<Entry> entries_;
};

}  // namespace tactus::study
