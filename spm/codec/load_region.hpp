/// Loads a region of a model that is in this process, through the same codec as a received region.
#pragma once

#include <optional>

#include "spm/cache.hpp"
#include "spm/codec/compressed_model.hpp"

namespace tactus::spm::codec {

/// Encodes and decodes a region with the records that `cache` lacks. Returns nothing if the region is damaged. `cache`
/// must have admitted the model as `object`. O(list), less than 1 us a record; allocates. To be called in the thread
/// that uses the cache.
[[nodiscard]] std::optional<RegionData> region_data(const CompressedModel& model, RegionId region, const Cache& cache,
                                                    ObjectIndex object);

/// Passes the result of `region_data` to Cache::accept, which sets `list`. A damaged region is kMalformed.
/// If the result is not kAccepted, the cache is unchanged.
[[nodiscard]] AcceptResult load_region(const CompressedModel& model, RegionId region, Cache& cache, ObjectIndex object,
                                       RegionList& list);

}  // namespace tactus::spm::codec
