/// The leaves of an AbTree around a sphere with their distances. A proxy that slides makes many sweeps from nearly the
/// same position; all but the first find their candidates here.
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
  /// Width of the layer around the sphere whose leaves are cached, in radii. A wider layer makes the first sweep
  /// slower; a narrower one serves fewer sweeps.
  static constexpr double kAround = 0.03;
  static constexpr std::uint32_t kMaxLeaves = 512;

  struct Leaf {
    const TreeNode* node;
    double distance;  ///< from the centre to its nearest triangle
    unsigned lanes;   ///< bits of the triangles within the reach
  };

  /// Identifies a mesh: its pool, the version of its AbTree, and the number of its AbTree::keep if it is a previous
  /// version.
  struct Mesh {
    const NodePool* pool = nullptr;
    std::uint64_t version = 0, keeping = 0;
    [[nodiscard]] bool operator==(const Mesh& other) const noexcept {
      return pool == other.pool && version == other.version && keeping == other.keeping;
    }
  };
  Mesh mesh;
  std::uint64_t used = 0;  ///< time of the last use; the least recently used cache is replaced

  Vec3d centre = Vec3d::Zero();
  double reach = -1;     ///< every triangle within this distance of the centre is in a leaf here
  bool crowded = false;  ///< there are more leaves than fit
  std::uint32_t count = 0;
  std::array<Leaf, kMaxLeaves> leaves;

  /// The distance around `point` within which all triangles are here; below 0: none.
  [[nodiscard]] double known_around(const Vec3d& point) const noexcept { return reach - (point - centre).norm(); }
};

/// Caches for two meshes (versions or objects) and two positions of a proxy each. Allocates at construction. Do not use
/// it after a NodePool that it was used with is destroyed.
class CandidateCaches {
 public:
  static constexpr std::uint32_t kCount = 4;
  CandidateCaches() : caches_(kCount) {}

  /// A cache with all triangles of `mesh` within `within` of `point`, or null.
  [[nodiscard]] const CandidateCache* find(const CandidateCache::Mesh& mesh, const Vec3d& point,
                                           double within) const noexcept {
    for (const CandidateCache& cache : caches_)
      if (cache.mesh == mesh && cache.known_around(point) >= within) return &cache;
    return nullptr;
  }
  /// The same, and counts as a use.
  [[nodiscard]] const CandidateCache* use(const CandidateCache::Mesh& mesh, const Vec3d& point,
                                          double within) noexcept {
    const CandidateCache* const found = find(mesh, point, within);
    if (found != nullptr) caches_[static_cast<std::size_t>(found - caches_.data())].used = ++used_;
    return found;
  }
  /// The least recently used cache, to be filled again.
  [[nodiscard]] CandidateCache& replace() noexcept {
    CandidateCache& oldest =
        *std::min_element(caches_.begin(), caches_.end(),
                          [](const CandidateCache& a, const CandidateCache& b) noexcept { return a.used < b.used; });
    oldest.used = ++used_;
    return oldest;
  }

 private:
  std::vector<CandidateCache> caches_;
  std::uint64_t used_ = 0;
};

}  // namespace tactus::spm
