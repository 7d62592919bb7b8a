/// Loads a region of a model that is in this process, through the same codec as a received region.
#pragma once

#include "spm/cache.hpp"
#include "spm/codec/compressed_model.hpp"

namespace tactus::spm::codec {

/// Encodes the records of the region that `cache` lacks, decodes them and passes them to Cache::accept, which sets
/// `list`. `cache` must have admitted the model as `object`. If the cache is full or the region is damaged, returns
/// false; the cache is then unchanged. O(list), less than 1 us a record; allocates. To be called in the thread that
/// uses the cache.
[[nodiscard]] bool load_region(const CompressedModel& model, RegionId region, Cache& cache, ObjectIndex object,
                               RegionList& list);

}  // namespace tactus::spm::codec
