/// Holds the static objects with which a host's movable bodies collide, and refines them around contacts.
///
///     contacts of recent steps --> regions around them, decoded from the model --> Forest --> next steps
///
/// The scenery has a cache and forests as an HRTC does, but loads regions from the model and not from the network. The
/// search for contacts begins some millimetres before a body touches the surface. So the surface has its finest
/// resolution at the touch, unless the body is faster than 1 m/s. Memory is fixed at construction; when it is used up,
/// the mesh stays coarser. World frame, metres. One thread at a time. Not realtime: decoding a new region takes some
/// tenths of a millisecond.
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
  const spm::codec::CompressedModel* model = nullptr;  ///< must outlive the scenery
};

class Scenery {
 public:
  /// `slots`: number of slots for records, in addition to those of the base meshes. Ignores objects after the first
  /// spm::kMaxObjects.
  explicit Scenery(const std::vector<StaticObject>& objects, std::uint32_t slots = 1u << 16);
  ~Scenery();

  /// Refines around `points`, the contact points of all bodies. Decodes at most eight new regions in each call. Regions
  /// around earlier points stay refined until their memory is needed.
  void refine_around(const std::vector<haptics::Vec3d>& points);
  [[nodiscard]] const haptics::SurfaceDistance& surface() const noexcept { return scene_; }

  /// Returns whether the mesh within the sphere is the finest one.
  [[nodiscard]] bool is_exact(const haptics::Vec3d& centre, double radius) const;
  /// Returns the number of regions decoded since the construction.
  [[nodiscard]] std::uint64_t regions_loaded() const noexcept { return regions_loaded_; }
  /// Returns the number of regions that could not be decoded since the construction.
  [[nodiscard]] std::uint64_t regions_damaged() const noexcept { return regions_damaged_; }

 private:
  struct Object;

  spm::AcceptResult load(Object& object, spm::RegionId region);
  void release_unwanted(const std::vector<std::vector<spm::RegionId>>& wanted);

  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::Cache cache_;
  std::vector<std::unique_ptr<Object>> objects_;
  sharing::Scene scene_;
  std::uint64_t regions_loaded_ = 0, regions_damaged_ = 0;
};

}  // namespace tactus::host_service
