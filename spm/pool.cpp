#include "spm/pool.hpp"

#include "spm/cache.hpp"
#include "spm/candidate_cache.hpp"
#include "spm/compact_index.hpp"
#include "spm/flat_index.hpp"
#include "spm/free_set.hpp"
#include "spm/loaded_front.hpp"

namespace tactus::spm {

static_assert(2ull * kMaxSlots < kNone / 2 && kMaxCompressedBlocks <= 1u << FlatIndex::kValueBits &&
              kMaxObjects <= 256);
static_assert(std::uint64_t{kMaxObjects} * kMaxVertices <= 1ull << FlatIndex::kKeyBits);

std::uint64_t PoolSettings::bytes() const noexcept {
  const std::uint64_t per_slot = sizeof(RecordPart) + sizeof(Vertex) + 2 * sizeof(LeafLane) + sizeof(SlotState) +
                                 2 * LoadedFront<RowIndex, Slot, PackedSlot>::kBytesPerFace + sizeof(std::uint16_t) +
                                 sizeof(std::uint32_t) + 2 * sizeof(std::uint8_t);
  return per_slot * slots + CompactIndex::bytes(slots) + CompactIndex::bytes(2 * slots) + FreeSet::bytes(slots) +
         std::uint64_t{kTreeNodeBytes} * tree_nodes +
         (kTreeNodeBytes + sizeof(std::uint32_t)) * std::uint64_t{kMaxPreviousLeaves} +
         CandidateCaches::kCount * sizeof(CandidateCache) + CompactIndex::bytes(tree_nodes) +
         FreeSet::bytes(tree_nodes) + (sizeof(ListBlock) + sizeof(std::uint32_t)) * list_blocks +
         Cache::table_bytes(list_blocks) +
         (kCompressedBlockBytes + 3 * sizeof(std::uint16_t)) * std::uint64_t{compressed_blocks} +
         FlatIndex::bytes(compressed_blocks);
}

PoolSettings PoolSettings::for_slots(std::uint32_t slots) noexcept {
  const std::uint32_t tree_nodes = std::min(slots / 4 * 3 + 1536, std::max(slots / 8 + 6144, 9216u));
  return {slots, tree_nodes, slots / 14 + 256, std::min(6 * slots, kMaxCompressedBlocks)};
}

PoolSettings PoolSettings::for_bytes(std::uint64_t bytes) noexcept {
  std::uint32_t fits = 0, too_many = kMaxSlots + 1;
  while (too_many - fits > 1) {
    const std::uint32_t slots = fits + (too_many - fits) / 2;
    (for_slots(slots).bytes() <= bytes ? fits : too_many) = slots;
  }
  return for_slots(fits);
}

Pool::Pool(PoolSettings pool_settings)
    : settings{pool_settings},
      parts(settings.slots),
      vertices(settings.slots),
      shown_at(2 * std::size_t{settings.slots}),
      state(settings.slots),
      blocks(settings.list_blocks) {}

}  // namespace tactus::spm
