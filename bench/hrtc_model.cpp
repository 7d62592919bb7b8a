#include "bench/hrtc_model.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "spm/codec/region_codec.hpp"

namespace tactus::bench {

std::uint32_t slots_for(const spm::ModelSummary& summary, double share, std::uint32_t min) {
  const std::uint32_t base = std::max(summary.base_vertices, (summary.base_faces + 1) / 2);
  return base + std::max(static_cast<std::uint32_t>(share * summary.parts), min);
}

spm::Cache::Admitted HrtcModel::admit(spm::Cache& cache, const spm::BaseMesh& base) {
  spm::Cache::Admitted admitted = cache.admit(base);
  if (!admitted.fits)
    throw std::runtime_error("a base mesh of " + std::to_string(base.positions.size()) +
                             " vertices does not fit a pool of " + std::to_string(cache.slots_free()) + " slots");
  return admitted;
}

HrtcModel::HrtcModel(const spm::Model& model, spm::PoolSettings settings)
    : model_{model},
      encoded_{model},
      pool_{settings},
      nodes_{settings.tree_nodes},
      cache_{pool_},
      admitted_{admit(cache_, spm::base_mesh_of(model))},
      forest_{pool_,
              nodes_,
              admitted_.object,
              model.summary,
              spm::RegionGrid{model.summary.grid, model.regions},
              std::move(admitted_.base)},
      listed_(model.summary.records, 0) {
  spm::Budget start{~0u};
  if (forest_.advance(start) != spm::Advance::kDone)
    throw std::runtime_error("a base mesh of " + std::to_string(model.summary.base_faces) + " faces does not fit " +
                             std::to_string(settings.tree_nodes) + " tree nodes");
  forest_.refit();
}

spm::RegionData HrtcModel::message(spm::RegionId region, bool all_records) const {
  std::vector<spm::Interval> sent;
  for (const spm::Interval& interval : model_.intervals_of(region))
    for (std::uint32_t record = interval.first; record < interval.first + interval.count; ++record) {
      if (!all_records && listed_[record] > 0) continue;
      if (!sent.empty() && sent.back().first + sent.back().count == record)
        ++sent.back().count;
      else
        sent.push_back({record, 1});
    }
  auto decoded = spm::codec::decode_region(*spm::codec::encode_region(encoded_.compressed(), region, sent),
                                           model_.summary, encoded_.compressed().tables());
  if (!decoded) throw std::runtime_error("region " + std::to_string(index(region)) + ": " + decoded.error().text);
  return std::move(*decoded);
}

spm::AcceptResult HrtcModel::load(const spm::RegionData& data) {
  spm::RegionList list;
  const spm::AcceptResult result =
      cache_.accept(admitted_.object, data, list_summary(model_.regions[index(data.region)]), list);
  if (result != spm::AcceptResult::kAccepted) return result;
  forest_.add(data.region, list);
  for (const spm::Interval& interval : data.list)
    for (std::uint32_t record = interval.first; record < interval.first + interval.count; ++record)
      if (listed_[record]++ == 0) ++records_held_;
  return result;
}

std::uint32_t HrtcModel::release_retired() {
  std::uint32_t released = 0;
  for (spm::RegionId region; (region = forest_.take_retired()) != spm::kNone; ++released) {
    cache_.release(admitted_.object, region);
    for (const spm::Interval& interval : model_.intervals_of(region))
      for (std::uint32_t record = interval.first; record < interval.first + interval.count; ++record)
        if (--listed_[record] == 0) --records_held_;
  }
  return released;
}

}  // namespace tactus::bench
