/// An HRTC's run time around one model: pool, cache, forest and tree, without network, threads or prediction.
///
/// Each region comes encoded and decoded as if from a host: its list, and the records that no held region lists.
/// Allocates. File units, model frame.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/cache.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/forest.hpp"
#include "spm/model.hpp"

namespace tactus::bench {

class HrtcModel {
 public:
  /// `model` must outlive it. Shows the base mesh. Throws std::runtime_error when that does not fit.
  HrtcModel(const spm::Model& model, spm::PoolSettings settings);
  HrtcModel(const HrtcModel&) = delete;
  HrtcModel& operator=(const HrtcModel&) = delete;

  /// What a host would send now; `whole`: with the records that are here already, too.
  [[nodiscard]] spm::RegionData message(spm::RegionId region, bool whole) const;
  /// Takes a message of a region that is not held.
  [[nodiscard]] spm::AcceptResult load(const spm::RegionData& data);
  /// Frees what the forest has given back; returns how many regions.
  std::uint32_t release_retired();

  [[nodiscard]] spm::Forest& forest() noexcept { return forest_; }
  [[nodiscard]] const spm::Forest& forest() const noexcept { return forest_; }
  [[nodiscard]] const spm::Cache& cache() const noexcept { return cache_; }
  [[nodiscard]] spm::ObjectIndex object() const noexcept { return admitted_.object; }
  [[nodiscard]] const spm::Model& model() const noexcept { return model_; }
  [[nodiscard]] const spm::Pool& pool() const noexcept { return pool_; }
  /// Records that some held region lists.
  [[nodiscard]] std::uint32_t records_held() const noexcept { return records_held_; }

 private:
  [[nodiscard]] static spm::Cache::Admitted admit(spm::Cache& cache, const spm::BaseMesh& base);

  const spm::Model& model_;
  spm::codec::EncodedModel encoded_;
  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::Cache cache_;
  spm::Cache::Admitted admitted_;
  spm::Forest forest_;
  std::vector<std::uint16_t> listed_;  // by record: held regions that list it
  std::uint32_t records_held_ = 0;
};

/// Slots for the base mesh and a share of all records, `least` at least.
[[nodiscard]] std::uint32_t slots_for(const spm::ModelSummary& summary, double share, std::uint32_t min = 0);

}  // namespace tactus::bench
