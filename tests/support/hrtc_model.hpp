/// Test fixture with the cache, the forest and the tree that an HRTC has for one model, without threads and DDS.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <span>
#include <vector>

#include "spm/cache.hpp"
#include "spm/codec/interval_codec.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "spm/forest.hpp"

namespace tactus::test_support {

class HrtcModel {
 public:
  HrtcModel(const spm::Model& model, spm::PoolSettings settings)
      : model_{model}, encoded_{model}, pool_{settings}, nodes_{settings.tree_nodes}, cache_{pool_} {
    const spm::BaseMesh base = spm::base_mesh_of(model);
    spm::Cache::Admitted admitted = cache_.admit(base);
    EXPECT_TRUE(admitted.fits);
    object_ = admitted.object;
    forest_ = std::make_unique<spm::Forest>(
        pool_, nodes_, object_, base.summary,
        spm::RegionGrid{model.summary.grid, model.regions}, std::move(admitted.base));
  }

  /// Returns the message that a host sends for `region`: its closed list, and the listed records that are not loaded.
  [[nodiscard]] spm::RegionData message(spm::RegionId region) const {
    std::vector<bool> loaded(model_.summary.records, false);
    for (std::uint32_t other = 0; other < model_.summary.regions; ++other)
      if (cache_.is_loaded(object_, spm::RegionId{other}))
        for (const spm::Interval& interval : model_.intervals_of(spm::RegionId{other}))
          std::fill_n(loaded.begin() + interval.first, interval.count, true);
    std::vector<spm::Interval> missing;
    for (const spm::Interval& interval : model_.intervals_of(region))
      for (std::uint32_t record = interval.first; record < interval.first + interval.count; ++record) {
        if (loaded[record]) continue;
        if (!missing.empty() && missing.back().first + missing.back().count == record)
          ++missing.back().count;
        else
          missing.push_back({record, 1});
      }
    return decoded(*spm::codec::encode_region(encoded_.compressed(), region, missing));
  }

  /// Returns the message of a faulty host, which contains `list` instead of the region's closed list.
  [[nodiscard]] spm::RegionData false_message(spm::RegionId region, const std::vector<spm::Interval>& list) const {
    const spm::codec::CompressedModel& coded = encoded_.compressed();
    std::uint32_t count = 0;
    for (const spm::Interval& interval : list) count += interval.count;
    const spm::Interval all_entries{0, count};
    spm::codec::BitWriter out;
    out.put(index(region), 32);
    put_intervals(out, coded.tables(), list);
    put_intervals(out, coded.tables(), {&all_entries, 1});
    coded.put_records(out, list);
    return decoded(out.take());
  }

  /// Passes a message to the cache, with the summary of its region in the model.
  spm::AcceptResult accept(const spm::RegionData& message, spm::RegionList& list) {
    return cache_.accept(object_, message, spm::list_summary(model_.regions[index(message.region)]), list);
  }

  spm::AcceptResult load(spm::RegionId region) {
    spm::RegionList list;
    const spm::AcceptResult result = accept(message(region), list);
    if (result == spm::AcceptResult::kAccepted) forest_->add(region, list);
    return result;
  }

  /// Refines `regions` with a budget of `units` and refits the tree. `unrequested` selects the treatment of all other
  /// regions.
  spm::Advance refine(const std::vector<spm::RegionId>& regions, std::uint32_t units = 1u << 30,
                      spm::ChangeDetector* detectors = nullptr, std::uint32_t detector_count = 0,
                      spm::Unrequested unrequested = spm::Unrequested::kCoarsen) {
    forest_->set_targets(regions.data(), static_cast<std::uint32_t>(regions.size()), unrequested);
    spm::Budget budget{units};
    const spm::Advance result = forest_->advance(budget);
    forest_->refit(detectors, detector_count);
    return result;
  }

  /// Releases from the cache the regions that the forest has retired.
  void release_retired() {
    for (spm::RegionId region; (region = forest_->take_retired()) != spm::kNone;) cache_.release(object_, region);
  }

  [[nodiscard]] spm::VertexId vertex_id(spm::Slot slot) const { return pool_.vertices[slot].id; }
  [[nodiscard]] const spm::Pool& pool() const { return pool_; }

  /// Overwrites the vertex ids in the slots of released records, so that they match no record. Requires that no region
  /// is loaded.
  void wipe_records() {
    for (spm::Vertex& vertex : pool_.vertices)
      if (index(vertex.id) >= model_.summary.base_vertices) vertex.id = {};
  }

  [[nodiscard]] const spm::codec::CompressedModel& compressed() const { return encoded_.compressed(); }
  [[nodiscard]] spm::Forest& forest() { return *forest_; }
  [[nodiscard]] spm::Cache& cache() { return cache_; }
  [[nodiscard]] spm::NodePool& nodes() { return nodes_; }
  [[nodiscard]] spm::ObjectIndex object() const { return object_; }
  [[nodiscard]] const spm::Model& model() const { return model_; }

 private:
  [[nodiscard]] spm::RegionData decoded(const spm::codec::Bytes& bytes) const {
    auto data = spm::codec::decode_region(bytes, model_.summary, encoded_.compressed().tables());
    if (data) return std::move(*data);
    ADD_FAILURE() << data.error().text;
    return {};
  }

  spm::Model model_;
  spm::codec::EncodedModel encoded_;
  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::Cache cache_;
  spm::ObjectIndex object_{};
  std::unique_ptr<spm::Forest> forest_;
};

}  // namespace tactus::test_support
