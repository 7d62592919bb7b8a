/// The static objects with which a host's movable bodies collide: base meshes, refined around contacts.
///
///     contacts of recent steps --> regions around them, decoded from the model --> Forest --> next steps
///
/// Uses the same cache and forest as an HRTC, filled from the model itself. The search for contacts begins at a
/// distance, so the surface there is at the finest resolution in time, except for bodies faster than 1 m/s. Memory is
/// fixed at construction; when it is used up, the mesh stays coarser. World frame, metres. One thread at a time. Not
/// realtime: decoding a new region takes some tenths of a millisecond.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "haptics/surface.hpp"
#include "sharing/scene.hpp"
#include "spm/codec/compressed_model.hpp"
#include "spm/forest.hpp"

namespace tactus::host_service {

struct StaticObject {
  session::Pose pose;
  double scale = 1;                                    ///< metres per file unit
  const spm::codec::CompressedModel* model = nullptr;  ///< outlives the scenery
};

class Scenery {
 public:
  /// `slots`: for records, besides those of the base meshes. Objects after the first spm::kMaxObjects are ignored.
  explicit Scenery(const std::vector<StaticObject>& objects, std::uint32_t slots = 1u << 16);
  ~Scenery();

  /// Refines around the contact points of all bodies at once. Regions around earlier points may become coarse again.
  void refine_around(const std::vector<haptics::Vec3d>& places);
  [[nodiscard]] const haptics::SurfaceDistance& surface() const noexcept { return scene_; }

  /// Whether the mesh within the sphere is the finest one.
  [[nodiscard]] bool exact(const haptics::Vec3d& centre, double radius) const;
  /// Regions decoded since the start.
  [[nodiscard]] std::uint64_t regions_loaded() const noexcept { return regions_loaded_; }

 private:
  struct Object;

  [[nodiscard]] bool load(Object& object, spm::RegionId region);
  void release_unwanted(const std::vector<std::vector<spm::RegionId>>& wanted);

  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::Cache cache_;
  std::vector<std::unique_ptr<Object>> objects_;
  sharing::Scene scene_;
  std::uint64_t regions_loaded_ = 0;
};

}  // namespace tactus::host_service
