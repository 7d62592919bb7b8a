/// The size of an object's directory: where its regions are, which of them are loaded, and which records have been
/// here. It is separate from the pool. It has an entry for each region and record, so it grows with the model.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/cache.hpp"
#include "spm/forest.hpp"

namespace tactus::spm {

/// For each region, in the loader (hrtc_service/loader.hpp).
inline constexpr std::uint32_t kRegionNoteBytes = 12;
/// For each record: has been received before (spm/codec/compressed_cache.hpp).
inline constexpr std::uint32_t kRecordNoteBits = 1;

[[nodiscard]] inline std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool) noexcept {
  return Cache::directory_bytes(summary) + Forest::directory_bytes(summary, pool) +
         std::uint64_t{summary.regions} * kRegionNoteBytes + std::uint64_t{summary.records} * kRecordNoteBits / 8;
}

/// Number of AB-tree nodes above the given faces (FaceIds, spm/ab_tree.hpp). O(n log n), allocates.
[[nodiscard]] inline std::uint32_t tree_nodes_over(std::vector<std::uint32_t> faces, std::uint32_t finest_faces) {
  std::sort(faces.begin(), faces.end());
  std::uint32_t nodes = 0;
  for (std::uint64_t covered = 1; covered == 1 || covered < finest_faces; covered *= 8) {
    for (std::uint32_t& id : faces) id >>= 3;
    faces.erase(std::unique(faces.begin(), faces.end()), faces.end());
    nodes += static_cast<std::uint32_t>(faces.size());
  }
  return nodes;
}
[[nodiscard]] inline std::uint32_t tree_nodes_over(std::span<const BaseFace> base, std::uint32_t finest_faces) {
  std::vector<std::uint32_t> faces;
  for (const BaseFace& face : base) faces.push_back(index(face.face));
  return tree_nodes_over(std::move(faces), finest_faces);
}

/// Divides the memory for models: an eighth for directories, at least 8 MiB, at most half; the rest for the pool.
struct MemoryShares {
  PoolSettings pool;
  std::uint64_t directories;
};
[[nodiscard]] inline MemoryShares shares_of(std::uint64_t bytes) noexcept {
  constexpr std::uint64_t kMin = 8u << 20;
  const std::uint64_t directories = std::max(bytes / 8, std::min(bytes / 2, kMin));
  return {PoolSettings::for_bytes(bytes - directories), directories};
}

}  // namespace tactus::spm
