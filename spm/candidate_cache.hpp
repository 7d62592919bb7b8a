/// A cache of the leaves of an AbTree near a sphere, with their distances. A sliding proxy makes many sweeps from
/// nearly the same position. The first sweep fills the cache; the others find their candidates in it.
///
/// Model frame, file units. Fixed memory. The caller owns the caches and passes them to each query, so queries in
/// several threads share no mutable state. One thread at a time.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm {

class NodePool;
struct TreeNode;

struct CandidateCache {
  /// The cache contains the leaves in the sphere and in a layer of this width around it, in radii of the sphere. With a
  /// wider layer, the first sweep is slower; with a narrower layer, fewer sweeps can use the cache.
  static constexpr double kLayer = 0.03;
  static constexpr std::uint32_t kMaxLeaves = 512;

  struct Leaf {
    const TreeNode* node;
    double distance;  ///< distance of the centre from the nearest triangle of the leaf
    unsigned lanes;   ///< bits of the triangles within `reach` of the centre
  };

  /// Identifies a version of a mesh. `previous_number` is 0 for the current version of the AbTree; for a previous
  /// version it is the number of the call of AbTree::store_previous.
  struct Mesh {
    const NodePool* pool = nullptr;
    std::uint64_t version = 0, previous_number = 0;
    [[nodiscard]] bool operator==(const Mesh& other) const noexcept {
      return pool == other.pool && version == other.version && previous_number == other.previous_number;
    }
  };
  Mesh mesh;
  std::uint64_t last_use = 0;  ///< number of the last use; the least recently used cache is replaced

  Vec3d centre = Vec3d::Zero();
  double reach = -1;          ///< every triangle within this distance of the centre is in a cached leaf
  bool is_truncated = false;  ///< there were more leaves than fit
  std::uint32_t count = 0;
  std::array<Leaf, kMaxLeaves> leaves;

  /// The cache contains all triangles within the returned distance of `point`. Negative if there is no such distance.
  [[nodiscard]] double complete_radius(const Vec3d& point) const noexcept { return reach - (point - centre).norm(); }
};

/// The caches of a proxy. There are enough for two positions on each of two meshes; the meshes are two versions of one
/// object or the meshes of two objects. Allocates at construction. Every NodePool with which the caches are used must
/// outlive their last use.
class CandidateCaches {
 public:
  static constexpr std::uint32_t kCount = 4;
  CandidateCaches() : caches_(kCount) {}

  /// Returns a cache that contains all triangles of `mesh` within `radius` of `point`, or null.
  [[nodiscard]] const CandidateCache* find(const CandidateCache::Mesh& mesh, const Vec3d& point,
                                           double radius) const noexcept {
    for (const CandidateCache& cache : caches_)
      if (cache.mesh == mesh && cache.complete_radius(point) >= radius) return &cache;
    return nullptr;
  }
  /// Like `find`, but also marks the returned cache as the most recently used.
  [[nodiscard]] const CandidateCache* find_and_mark_used(const CandidateCache::Mesh& mesh, const Vec3d& point,
                                                         double radius) noexcept {
    const CandidateCache* const found = find(mesh, point, radius);
    if (found != nullptr) caches_[static_cast<std::size_t>(found - caches_.data())].last_use = ++used_;
    return found;
  }
  /// Returns the least recently used cache, for the caller to fill, and marks it as the most recently used.
  [[nodiscard]] CandidateCache& replace() noexcept {
    CandidateCache& oldest = *std::min_element(
        caches_.begin(), caches_.end(),
        [](const CandidateCache& a, const CandidateCache& b) noexcept { return a.last_use < b.last_use; });
    oldest.last_use = ++used_;
    return oldest;
  }

 private:
  std::vector<CandidateCache> caches_;
  std::uint64_t used_ = 0;
};

}  // namespace tactus::spm
