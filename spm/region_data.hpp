/// A received region: its closed record list, and those of its records that the receiver did not have.
///
/// A message leaves out what the receiver can compute. All references are ids. `spm/codec` encodes and decodes the
/// bytes; Cache::accept completes and checks the records. Do not trust the contents before that.
#pragma once

#include <array>
#include <vector>

#include "spm/ids.hpp"
#include "spm/model.hpp"
#include "spm/position_predictor.hpp"
#include "spm/record.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

/// In `born_x`: the rest of the number is a position in the record's VertexRing, not a VertexId.
inline constexpr std::uint32_t kInRing = 1u << 31;
[[nodiscard]] constexpr VertexId ring_place(std::uint32_t place) noexcept { return VertexId{kInRing | place}; }
[[nodiscard]] constexpr bool in_ring(VertexId x) noexcept { return (index(x) & kInRing) != 0; }
/// The last position in the ring.
inline constexpr std::uint32_t kLastInRing = VertexRing<VertexId>::kMax;
/// In place of the id of a deformed face: the face that LoadedFront::swing finds from the previous one.
inline constexpr FaceId kSwing{(1u << 29) - 1};
/// The corner of a deformed face at which t is.
inline constexpr std::uint32_t kCornerOfParent = 3;

struct RegionData {
  RegionId region{};
  std::vector<Interval> list;  ///< the closed list: ascending intervals that do not touch
  std::vector<Interval> sent;  ///< the records in this message: a subset of `list`, in the same form
  /// For each record in `sent`, in order: from the position that PositionPredictor expects once the first part is
  /// decoded.
  std::vector<PositionPredictor::Residuals> residuals;
  /// The sent records in order, with all parts of a record together. If the first part deforms a face, `parent` is
  /// kNone and the first deformed corner gives the parent. All other deformed corners are kCornerOfParent.
  std::vector<RecordPart> parts;
};

}  // namespace tactus::spm
