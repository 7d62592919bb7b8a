/// Split, collapse, load, evict and reload in any order, cut anywhere, and the state that must come of it.
///
/// An operation is one record split, collapsed, loaded into its slot, evicted or loaded again. At the end some held
/// regions are refined and the rest coarsened; the mesh must then be the one that this set of regions determines,
/// whatever came before.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::bench {

struct TortureSettings {
  std::uint64_t operations = 1'000'000;
  double pool_share = 0.25;   ///< of the model's records
  std::uint32_t checks = 20;  ///< times on the way at which everything is recounted
  std::uint64_t seed = 1;
};

struct TortureResult {
  std::uint64_t splits = 0, collapses = 0, loaded = 0, evicted = 0, reloaded = 0;  ///< records
  std::uint64_t repeated = 0;                                                      ///< records sent that were here
  std::uint64_t regions_loaded = 0, regions_evicted = 0, refused_full = 0, steps = 0, cut_by_budget = 0;
  std::uint32_t checks = 0;
  std::uint32_t regions_at_end = 0;                       ///< refined
  std::uint64_t hash = 0;                                 ///< kept up record by record
  std::uint64_t expected_hash = 0;                        ///< from the model and the set of regions
  std::uint64_t fresh_hash = 0;                           ///< of a forest that never refined anything else
  std::uint64_t faces_compared = 0, faces_different = 0;  ///< with that forest's, corner by corner
  std::vector<std::string> problems;                      ///< the first few that checks found
  double seconds = 0;                                     ///< without the checks

  [[nodiscard]] std::uint64_t operations() const noexcept { return splits + collapses + loaded + evicted + reloaded; }
};

/// `model` must be sound. Allocates. Throws std::runtime_error when the base mesh does not fit the pool.
[[nodiscard]] TortureResult torture(const spm::Model& model, const TortureSettings& settings);

}  // namespace tactus::bench
