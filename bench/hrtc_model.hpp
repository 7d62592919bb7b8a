/// The data structures of an HRTC for one model: pool, cache, forest and tree, without network, threads or prediction.
///
/// Each message of a region is encoded and decoded, as between host and HRTC. Allocates. File units, model frame.
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
  /// Loads and shows the base mesh. `model` must outlive the object. Throws std::runtime_error if the base mesh does
  /// not fit the pool.
  HrtcModel(const spm::Model& model, spm::PoolSettings settings);
  HrtcModel(const HrtcModel&) = delete;
  HrtcModel& operator=(const HrtcModel&) = delete;

  /// Returns the message of `region` that a host would send now: the region's closed list, and the listed records that
  /// are not loaded. With `all_records`, the message also has the loaded records.
  [[nodiscard]] spm::RegionData message(spm::RegionId region, bool all_records) const;
  /// Loads the records of a message and adds its region to the forest. The region must not be loaded yet.
  [[nodiscard]] spm::AcceptResult load(const spm::RegionData& data);
  /// Frees the memory of the regions that the forest has retired. Returns the number of these regions.
  std::uint32_t release_retired();

  [[nodiscard]] spm::Forest& forest() noexcept { return forest_; }
  [[nodiscard]] const spm::Forest& forest() const noexcept { return forest_; }
  [[nodiscard]] const spm::Cache& cache() const noexcept { return cache_; }
  [[nodiscard]] spm::ObjectIndex object() const noexcept { return admitted_.object; }
  [[nodiscard]] const spm::Model& model() const noexcept { return model_; }
  [[nodiscard]] const spm::Pool& pool() const noexcept { return pool_; }
  /// Number of records in the closed lists of the loaded regions.
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
  std::vector<std::uint16_t> listed_;  // by record: number of loaded regions whose closed list has it
  std::uint32_t records_held_ = 0;
};

/// Returns the number of slots for the base mesh plus the number for `share` of all record parts, but at least `min`
/// for the record parts.
[[nodiscard]] std::uint32_t slots_for(const spm::ModelSummary& summary, double share, std::uint32_t min = 0);

}  // namespace tactus::bench
