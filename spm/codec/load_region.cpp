#include "spm/codec/load_region.hpp"

#include <vector>

#include "spm/codec/region_codec.hpp"

namespace tactus::spm::codec {

bool load_region(const CompressedModel& model, RegionId region, Cache& cache, ObjectIndex object, RegionList& list) {
  std::vector<Interval> missing;
  for (const Interval& interval : model.intervals_of(region))
    for (std::uint32_t record = interval.first; record < interval.first + interval.count; ++record) {
      if (cache.has_record(object, RecordId{record})) continue;
      if (!missing.empty() && missing.back().first + missing.back().count == record)
        ++missing.back().count;
      else
        missing.push_back({record, 1});
    }
  const Bytes message = encode_region(model, region, missing);
  const auto decoded = decode_region(message, model.summary(), model.tables());
  return decoded && cache.accept(object, *decoded, list) == AcceptResult::kAccepted;
}

}  // namespace tactus::spm::codec
