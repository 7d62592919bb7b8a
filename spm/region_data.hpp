/// One region as it travels: its closed record list, and those of its records that the receiver lacks.
///
/// All in ids. `spm/codec` makes the bytes; Cache::accept takes this. Nothing in it is trusted until the cache has
/// checked it against what it holds.
#pragma once

#include <array>
#include <vector>

#include "spm/ids.hpp"
#include "spm/model.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

struct RegionData {
  RegionId region{};
  std::vector<Run> list;                        ///< the region's whole closed list: ascending runs that do not touch
  std::vector<Run> sent;                        ///< the records in this message, a subset of `list`, same form
  std::vector<std::array<float, 3>> positions;  ///< one for each record in `sent`, in order
  /// The sent records, in order. A chain's parts follow each other; `next` is the index in this array of the next part,
  /// or kNone.
  std::vector<RecordPart> parts;
};

}  // namespace tactus::spm
