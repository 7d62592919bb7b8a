/// A region from a model in this process, as if a host had sent it.
#pragma once

#include "spm/cache.hpp"
#include "spm/codec/compressed_model.hpp"

namespace tactus::spm::codec {

/// Encodes what `cache` lacks of the region, decodes it and has the cache accept it, which must have admitted the model
/// as `object`; `list` is as Cache::accept writes it. False, and nothing has changed, when the cache has no room.
/// O(list), less than 1 us a record; allocates. The cache's thread.
[[nodiscard]] bool take_region(const CompressedModel& model, RegionId region, Cache& cache, ObjectIndex object,
                               RegionList& list);

}  // namespace tactus::spm::codec
