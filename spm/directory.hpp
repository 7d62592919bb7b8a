/// The sizes of directories. The directory of an object lists the regions of its pages, the loaded regions, and some of
/// the received records. It has an entry for each base face, and is not part of the pool.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/cache.hpp"
#include "spm/forest.hpp"

namespace tactus::spm {

/// Max number of pages that an HRTC has of one object, and that a viewer has, which needs all with regions.
inline constexpr std::uint32_t kMaxObjectPages = 4096, kMaxWholePages = 1u << 17;
/// Bytes for each region in the loader besides its grid: the progress of the region, and the summary of its list
/// (hrtc_service/loader.hpp).
inline constexpr std::uint32_t kLoaderBytesPerRegion = 20;
/// Bytes for each object in the compressed cache: some of the received records (spm/codec/received_records.hpp).
inline constexpr std::uint32_t kReceivedRecordsBytes = 16'384;

/// Returns the bytes of an object's directory without its pages. Gateway and servo have a grid each.
[[nodiscard]] inline std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool,
                                                   std::uint32_t max_pages) noexcept {
  return Cache::directory_bytes(summary) + Forest::directory_bytes(summary, pool) + 2 * RegionGrid::bytes(max_pages) +
         kReceivedRecordsBytes;
}
/// Returns the bytes of a page in the directory.
[[nodiscard]] inline std::uint64_t page_bytes(const RegionPage& page) noexcept {
  return 2 * page.bytes() + std::uint64_t{page.end_region() - page.first_region()} * kLoaderBytesPerRegion;
}
/// Returns the bytes of a page with these regions in the directory.
[[nodiscard]] inline std::uint64_t page_bytes(std::span<const Region> regions) noexcept {
  return 2 * RegionPage::bytes(regions) + regions.size() * kLoaderBytesPerRegion;
}

/// Returns the number of AB-tree nodes (spm/ab_tree.hpp) above the faces with the given FaceIds. O(n log n), allocates.
[[nodiscard]] inline std::uint32_t tree_nodes_above(std::vector<std::uint32_t> faces, std::uint32_t finest_faces) {
  std::sort(faces.begin(), faces.end());
  std::uint32_t nodes = 0;
  for (std::uint64_t covered = 1; covered == 1 || covered < finest_faces; covered *= 8) {
    for (std::uint32_t& id : faces) id >>= 3;
    faces.erase(std::unique(faces.begin(), faces.end()), faces.end());
    nodes += static_cast<std::uint32_t>(faces.size());
  }
  return nodes;
}
[[nodiscard]] inline std::uint32_t tree_nodes_above(std::span<const BaseFace> base, std::uint32_t finest_faces) {
  std::vector<std::uint32_t> faces;
  for (const BaseFace& face : base) faces.push_back(index(face.face));
  return tree_nodes_above(std::move(faces), finest_faces);
}

/// Returns the bytes of an object's directory with all its pages, from all regions of the model. O(regions).
[[nodiscard]] inline std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool,
                                                   std::span<const Region> regions) noexcept {
  std::uint64_t bytes = 0;
  std::uint32_t pages = 0;
  for (; !regions.empty(); ++pages) {
    const std::size_t count = RegionPage::leading(regions);
    bytes += page_bytes(regions.first(count));
    regions = regions.subspan(count);
  }
  return bytes + directory_bytes(summary, pool, pages);
}

/// Estimates the bytes of an object's directory with all its pages. Assumes 40 regions in a page, and that a quarter of
/// the regions is in pages with divided cells.
[[nodiscard]] inline std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool) noexcept {
  const std::uint64_t regions = summary.regions, pages = regions / 40 + 1;
  const std::uint64_t grid =
      pages * sizeof(RegionPage) + regions * RegionPage::kBytesPerRegion + regions / 4 * sizeof(std::uint32_t);
  const std::uint32_t max_pages = std::min(kMaxObjectPages, RegionGrid::pages_in_bounds(summary));
  return directory_bytes(summary, pool, max_pages) + 2 * grid + regions * kLoaderBytesPerRegion;
}

struct MemoryShares {
  PoolSettings pool;
  std::uint64_t directories;  ///< bytes
};
/// Divides the memory for models, `bytes`, between directories and pool. The directories get an eighth, or up to 7 MiB
/// if the pool keeps 5 MiB or half. 7 MiB is enough for a model of 32 million faces.
[[nodiscard]] inline MemoryShares memory_shares(std::uint64_t bytes) noexcept {
  constexpr std::uint64_t kDirectories = 7u << 20, kPool = 5u << 20;
  const std::uint64_t beside_pool = bytes - std::min(bytes / 2, kPool);
  const std::uint64_t directories = std::max(bytes / 8, std::min(kDirectories, beside_pool));
  return {PoolSettings::for_bytes(bytes - directories), directories};
}

}  // namespace tactus::spm
