/// The content of a region message: the closed list of the region, and the listed records that the receiver lacks.
///
/// A message omits data that the receiver can compute. All references are ids. `spm/codec` encodes and decodes the
/// bytes. Cache::accept completes and checks the records; before, the content is not trusted.
#pragma once

#include <array>
#include <vector>

#include "spm/ids.hpp"
#include "spm/model.hpp"
#include "spm/position_predictor.hpp"
#include "spm/record.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

/// A bit in `born_x`. If it is set, the other bits are a position in the record's VertexRing instead of a VertexId.
inline constexpr std::uint32_t kInRing = 1u << 31;
[[nodiscard]] constexpr VertexId ring_position(std::uint32_t position) noexcept { return VertexId{kInRing | position}; }
[[nodiscard]] constexpr bool in_ring(VertexId x) noexcept { return (index(x) & kInRing) != 0; }
/// Stands for the last position in the ring.
inline constexpr std::uint32_t kLastInRing = VertexRing<VertexId>::kMax;
/// Replaces the id of a deformed face that LoadedFront::swing finds from the previous deformed face.
inline constexpr FaceId kSwing{kMaxFaces - 1};
/// Replaces the corner number of a deformed face: the decoder finds the corner at which t is.
inline constexpr std::uint32_t kCornerOfParent = 3;

struct RegionData {
  RegionId region{};
  std::vector<Interval> list;  ///< the closed list: ascending intervals with at least one id between two of them
  std::vector<Interval> sent;  ///< the records in this message: a subset of `list`, in the same form
  /// Differences between the position of each sent record and the position that PositionPredictor expects.
  std::vector<PositionPredictor::Residuals> residuals;
  /// The sent records in order; the parts of a record are consecutive. If the first part deforms a face, `parent` is
  /// kNone and the first deformed corner determines the parent. All other deformed corners are kCornerOfParent.
  std::vector<RecordPart> parts;
};

}  // namespace tactus::spm
