#include "spm/codec/load_region.hpp"

#include <utility>
#include <vector>

#include "spm/codec/region_codec.hpp"

namespace tactus::spm::codec {

std::optional<RegionData> region_data(const CompressedModel& model, RegionId region, const Cache& cache,
                                      ObjectIndex object) {
  std::vector<Interval> missing;
  for (const Interval& interval : model.intervals_of(region))
    for (std::uint32_t record = interval.first; record < interval.first + interval.count; ++record) {
      if (cache.has_record(object, RecordId{record})) continue;
      if (!missing.empty() && missing.back().first + missing.back().count == record)
        ++missing.back().count;
      else
        missing.push_back({record, 1});
    }
  const Result<Bytes> message = encode_region(model, region, missing);
  if (!message) return std::nullopt;
  auto decoded = decode_region(*message, model.summary(), model.tables());
  if (!decoded) return std::nullopt;
  return std::move(*decoded);
}

AcceptResult load_region(const CompressedModel& model, RegionId region, Cache& cache, ObjectIndex object,
                         RegionList& list) {
  const std::optional<RegionData> data = region_data(model, region, cache, object);
  const ListSummary expected = list_summary(model.regions()[index(region)]);
  return data ? cache.accept(object, *data, expected, list) : AcceptResult::kMalformed;
}

}  // namespace tactus::spm::codec
