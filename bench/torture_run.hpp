/// Splits, collapses, loads, evicts and reloads records in random order, with random budgets, and checks the resulting
/// mesh.
///
/// An operation is one record that is split, collapsed, loaded into its slot, evicted or loaded again. At the end, some
/// of the loaded regions are refined and the others coarsened. This set of refined regions alone must determine the
/// mesh.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::bench {

struct TortureSettings {
  std::uint64_t operations = 1'000'000;
  double pool_share = 0.25;   ///< pool slots beyond the base mesh divided by the model's record parts
  std::uint32_t checks = 20;  ///< number of checks of all invariants before the end
  std::uint64_t seed = 1;
};

struct TortureResult {
  std::uint64_t splits = 0, collapses = 0, loaded = 0, evicted = 0, reloaded = 0;  ///< numbers of records
  std::uint64_t repeated = 0;  ///< number of records received that were loaded already
  std::uint64_t regions_loaded = 0, regions_evicted = 0;
  std::uint64_t refused_full = 0;              ///< number of regions refused by a full pool
  std::uint64_t steps = 0, cut_by_budget = 0;  ///< numbers of all steps, and of steps that ended at their budget
  std::uint32_t checks = 0;
  std::uint32_t regions_at_end = 0;                       ///< number of refined regions
  std::uint64_t hash = 0;                                 ///< mesh hash, updated by each split and collapse
  std::uint64_t expected_hash = 0;                        ///< mesh hash computed from model and refined regions
  std::uint64_t fresh_hash = 0;                           ///< mesh hash of a new forest with the same refined regions
  std::uint64_t faces_compared = 0, faces_different = 0;  ///< compared with the faces of the new forest
  std::vector<std::string> problems;                      ///< first violations
  double seconds = 0;                                     ///< wall time without checks

  [[nodiscard]] std::uint64_t operations() const noexcept { return splits + collapses + loaded + evicted + reloaded; }
};

/// `model` must have no violations. Allocates. Throws std::runtime_error if the base mesh does not fit the pool.
[[nodiscard]] TortureResult torture(const spm::Model& model, const TortureSettings& settings);

}  // namespace tactus::bench
