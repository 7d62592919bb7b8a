/// The objects of a host that stand, as its bodies meet them: the base mesh, and the finest one around contacts.
///
///     contacts of the last steps --> regions around them, decoded from the model --> Forest --> next steps
///
/// The same store and forest as an HRTC's, fed from the model itself. A contact is looked for before it touches, so its
/// surroundings are fine by then, but for bodies that come at over a metre a second. Memory is fixed at construction;
/// where it is used up the mesh stays coarser. World frame, metres. One thread at a time. Not realtime: a region that
/// is new takes some tenths of a millisecond.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "haptics/surface.hpp"
#include "sharing/scene.hpp"
#include "spm/codec/compressed_model.hpp"
#include "spm/forest.hpp"

namespace tactus::host_service {

struct StandingObject {
  session::Pose pose;
  double scale = 1;                                    ///< m in a file unit
  const spm::codec::CompressedModel* model = nullptr;  ///< outlives the scenery
};

class Scenery {
 public:
  /// `slots`: of records, beside those of base meshes. Of more than spm::kMaxObjects objects the first count.
  explicit Scenery(const std::vector<StandingObject>& objects, std::uint32_t slots = 1u << 16);
  ~Scenery();

  /// Refines around these places, of all bodies at once; what is around the places of before may become coarse again.
  void look(const std::vector<haptics::Vec3d>& places);
  [[nodiscard]] const haptics::SurfaceDistance& surface() const noexcept { return scene_; }

  /// Whether all that a ball meets is the finest mesh.
  [[nodiscard]] bool exact(const haptics::Vec3d& centre, double radius) const;
  /// Regions decoded since the start.
  [[nodiscard]] std::uint64_t regions_loaded() const noexcept { return regions_loaded_; }

 private:
  struct Object;

  [[nodiscard]] bool load(Object& object, spm::RegionId region);
  void give_back(const std::vector<std::vector<spm::RegionId>>& wanted);

  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::Cache cache_;
  std::vector<std::unique_ptr<Object>> objects_;
  sharing::Scene scene_;
  std::uint64_t regions_loaded_ = 0;
};

}  // namespace tactus::host_service
