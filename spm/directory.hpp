/// What a controller holds of an object whatever of it is loaded: where its regions are, which of them are here, which
/// of its records have been. Beside the pool, for all regions and records, so it grows with the model.
#pragma once

#include <algorithm>
#include <cstdint>

#include "spm/cache.hpp"
#include "spm/forest.hpp"

namespace tactus::spm {

/// Of each region, that a loader keeps (hrtc_service/loader.hpp).
inline constexpr std::uint32_t kRegionNoteBytes = 20;

[[nodiscard]] inline std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool) noexcept {
  return Cache::directory_bytes(summary) + Forest::directory_bytes(summary, pool) +
         std::uint64_t{summary.regions} * kRegionNoteBytes;
}

/// How a controller divides what it may hold of models: an eighth for directories, 8 MiB at least, but never more than
/// half.
struct MemoryShares {
  PoolSettings pool;
  std::uint64_t directories;
};
[[nodiscard]] inline MemoryShares shares_of(std::uint64_t bytes) noexcept {
  constexpr std::uint64_t kLeast = 8u << 20;
  const std::uint64_t directories = std::max(bytes / 8, std::min(bytes / 2, kLeast));
  return {PoolSettings::for_bytes(bytes - directories), directories};
}

}  // namespace tactus::spm
