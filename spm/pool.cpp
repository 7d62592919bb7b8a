#include "spm/pool.hpp"

namespace tactus::spm {

std::uint64_t PoolSettings::bytes() const noexcept {
  constexpr std::uint64_t kIndexBytesPerEntry = 16 * 4;
  constexpr std::uint64_t kFrontBytesPerFace = 3 * 4;
  const std::uint64_t per_slot = sizeof(RecordPart) + sizeof(Vertex) + sizeof(float) + 2 * sizeof(FaceRow) +
                                 sizeof(SlotState) + 3 * kIndexBytesPerEntry + 2 * kFrontBytesPerFace +
                                 sizeof(std::uint16_t) + sizeof(std::uint32_t);
  return per_slot * slots + (kTreeNodeBytes + kIndexBytesPerEntry) * tree_nodes +
         (sizeof(ListBlock) + sizeof(std::uint32_t)) * list_blocks;
}

Pool::Pool(PoolSettings pool_settings)
    : settings{pool_settings},
      parts(settings.slots),
      vertices(settings.slots),
      radius(settings.slots),
      faces(2 * std::size_t{settings.slots}),
      state(settings.slots),
      blocks(settings.list_blocks) {
  for (FaceRow& row : faces) row.node = kNone;
}

}  // namespace tactus::spm
