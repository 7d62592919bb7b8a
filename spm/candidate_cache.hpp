/// The leaves of a tree around a ball, each with how far it is: a proxy that slides asks for many sweeps that start
/// within a hair of one another, and all but the first find here what they can meet.
///
/// Model frame, file units. Fixed memory. Whoever asks owns the caches and gives them to each query, so that queries
/// in several threads share nothing that they change. One thread at a time.
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
  /// Of the ball's radius: how far around the ball there are leaves here. Further out costs each first sweep time, less
  /// far leaves more sweeps without.
  static constexpr double kAround = 0.03;
  static constexpr std::uint32_t kMaxLeaves = 512;

  struct Leaf {
    const TreeNode* node;
    double distance;  ///< of its nearest triangle from the centre
    unsigned lanes;   ///< bits of those that are not beyond the reach
  };

  /// Which mesh: of what pool, in what version of an AbTree and, for one that was kept, in what keeping.
  struct Mesh {
    const NodePool* pool = nullptr;
    std::uint64_t version = 0, keeping = 0;
    [[nodiscard]] bool operator==(const Mesh& other) const noexcept {
      return pool == other.pool && version == other.version && keeping == other.keeping;
    }
  };
  Mesh mesh;
  std::uint64_t used = 0;  ///< when; the one longest unused makes room

  Vec3d centre = Vec3d::Zero();
  double reach = -1;     ///< every triangle no further from the centre is in a leaf here
  bool crowded = false;  ///< there are more leaves than fit: what is here is not all
  std::uint32_t count = 0;
  std::array<Leaf, kMaxLeaves> leaves;

  /// How far around `point` it knows everything; below 0: not even at it.
  [[nodiscard]] double known_around(const Vec3d& point) const noexcept { return reach - (point - centre).norm(); }
};

/// Of two versions of a mesh or of two objects, around where a proxy was and where it is. Allocates when made, and is
/// of no use once a NodePool that it has been used with is gone.
class CandidateCaches {
 public:
  static constexpr std::uint32_t kCount = 4;
  CandidateCaches() : caches_(kCount) {}

  /// One that knows all of `mesh` within `within` of `point`; null when there is none.
  [[nodiscard]] const CandidateCache* find(const CandidateCache::Mesh& mesh, const Vec3d& point,
                                           double within) const noexcept {
    for (const CandidateCache& cache : caches_)
      if (cache.mesh == mesh && cache.known_around(point) >= within) return &cache;
    return nullptr;
  }
  /// The same; it becomes the last to make room.
  [[nodiscard]] const CandidateCache* use(const CandidateCache::Mesh& mesh, const Vec3d& point,
                                          double within) noexcept {
    const CandidateCache* const found = find(mesh, point, within);
    if (found != nullptr) caches_[static_cast<std::size_t>(found - caches_.data())].used = ++used_;
    return found;
  }
  /// The one longest unused, to be filled.
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
