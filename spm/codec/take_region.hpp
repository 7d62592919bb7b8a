/// Loads a region of a model in this process through the same codec as a received message.
#pragma once

#include "spm/cache.hpp"
#include "spm/codec/compressed_model.hpp"

namespace tactus::spm::codec {

/// Encodes the records of the region that `cache` lacks, decodes them and passes them to Cache::accept, which sets
/// `list`. `cache` must have admitted the model as `object`. False if the cache is full; it is then unchanged. O(list),
/// less than 1 us a record; allocates. The cache's thread.
[[nodiscard]] bool take_region(const CompressedModel& model, RegionId region, Cache& cache, ObjectIndex object,
                               RegionList& list);

}  // namespace tactus::spm::codec
