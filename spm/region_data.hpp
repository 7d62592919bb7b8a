/// One region as it travels: its closed record list, and those of its records that the receiver lacks.
///
/// What the receiver can find out by itself is left out. All in ids. `spm/codec` makes the bytes; Cache::accept takes
/// this and completes it. Nothing in it is trusted until the cache has checked it against what it holds.
#pragma once

#include <array>
#include <vector>

#include "spm/ids.hpp"
#include "spm/model.hpp"
#include "spm/record.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

/// In `born_x`: not a VertexId but a place in the record's VertexRing.
inline constexpr std::uint32_t kInRing = 1u << 31;
/// The last place there, wherever that is.
inline constexpr std::uint32_t kLastInRing = VertexRing::kMax;
/// In place of the id of a deformed face: the one that LoadedFront::swing finds after the one before.
inline constexpr std::uint32_t kNextAround = (1u << 29) - 1;
/// The corner of a deformed face where t stands, whichever it is.
inline constexpr std::uint32_t kCornerOfParent = 3;

struct RegionData {
  RegionId region{};
  std::vector<Interval> list;  ///< the region's whole closed list: ascending intervals that do not touch
  std::vector<Interval> sent;  ///< the records in this message, a subset of `list`, same form
  /// For each record in `sent`, in order: where it is, from its PositionPredictor once its first part is entered.
  std::vector<std::array<std::uint32_t, 3>> offsets;
  /// The sent records, in order. A chain's parts follow each other; `next` is the index in this array of the next part,
  /// or kNone. `parent` is kNone where the first part deforms a face: it stands there, at the corner given. All other
  /// deformed corners are kCornerOfParent.
  std::vector<RecordPart> parts;
};

}  // namespace tactus::spm
