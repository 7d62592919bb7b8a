/// Chooses how far regions that nobody touches are refined, so that the error on the screens of all pages is as small
/// as a budget of faces allows.
///
/// The radius of a vertex bounds the distance of the mesh around it from the finest mesh. So the radii in the base mesh
/// give the error e of each region without refinement, and e / (distance * pixel) is this error in pixels. The error of
/// a smooth surface is inversely proportional to its number of faces, so b base faces need b (e / t - 1) more faces for
/// an error of t pixels. One t for all regions, the smallest that the budget allows, gives equal errors on the screen.
///
/// No lock, thread or clock. Not realtime.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "sharing/scene.hpp"
#include "spm/forest.hpp"

namespace tactus::viewer {

/// The view of a page, world frame.
struct Camera {
  spm::Vec3d position = spm::Vec3d::Zero();
  spm::Vec3d direction = spm::Vec3d::UnitX();  ///< from the eye to the middle of the picture, unit vector
  double half_angle = 1;                       ///< rad, between `direction` and the corners of the picture
  double pixel = 1e-3;                         ///< rad, angle of a pixel
};

/// The base mesh in one region.
struct BaseRegion {
  float error = 0;          ///< max distance of the base mesh from the finest one, file units
  std::uint32_t faces = 0;  ///< number of base faces near the cell
};
/// Returns the base mesh in each region. `forest` must show its base mesh, without refinement. O(faces x regions in
/// their bounds).
[[nodiscard]] std::vector<BaseRegion> base_regions(const spm::Forest& forest);

class ScreenRefinement {
 public:
  /// No region is refined for a smaller error, pixels.
  static constexpr double kMinPixels = 0.25;

  /// Adds a region of an object that a camera may see. `entries`: length of its list. `distinct`: share of the entries
  /// of all lists of the object that are not repetitions, because neighbours have common records.
  void add(std::uint32_t object_index, std::uint32_t region, const BaseRegion& base, const spm::CellBox& box,
           const sharing::Placement& placement, std::uint32_t entries, double distinct,
           const std::map<std::uint64_t, Camera>& cameras);

  /// Returns the number of list entries to apply, by object index and region. Together they add at most `faces` faces,
  /// and the lists of these regions have at most `records` records. Both are estimates.
  [[nodiscard]] std::map<std::uint32_t, std::map<std::uint32_t, std::uint32_t>> choose(std::uint32_t faces,
                                                                                       std::uint32_t records) const;

 private:
  struct Candidate {
    std::uint32_t object_index, region;
    double pixels;  // error without refinement
    std::uint32_t base_faces, entries;
    double distinct;
    [[nodiscard]] std::uint32_t entries_for(double max_pixels) const noexcept;
  };
  std::vector<Candidate> candidates_;
};

}  // namespace tactus::viewer
