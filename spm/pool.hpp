/// The fixed memory of an HRTC for the records, vertices, faces and tree nodes of all its objects.
///
/// A slot holds one record part, the vertex that it adds, and the rows of the two faces that it bears. So a new face
/// needs no allocation, and a decoded record reaches everything that it changes without a look-up.
///
///   slot s:  parts[s]   vertices[s]   radius[s]   faces[2 s], faces[2 s + 1]   state[s]
///            64 B       16 B          4 B         2 x 32 B                     2 B
///
/// The loader (Cache) writes a slot before it hands the region over and after it got the region back. In between,
/// faces and state belong to the haptic thread (Forest). The rings that carry the regions order these accesses. The
/// slots of a base mesh are taken until the object is removed.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "spm/ids.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

/// Slots and objects of one pool fit a key of FlatIndex, and a face row fits its value.
inline constexpr std::uint32_t kMaxSlots = 1u << 26;
inline constexpr std::uint32_t kMaxObjects = 64;

/// Sized once, at start. An operator sets `slots` and `tree_nodes`; the others follow from them.
struct PoolSettings {
  std::uint32_t slots = 1u << 16;        ///< at most kMaxSlots; exceeded: a region is refused and stays coarse
  std::uint32_t tree_nodes = 1u << 14;   ///< exceeded: refinement stops, PoolFull is flagged
  std::uint32_t list_blocks = 1u << 13;  ///< blocks of 62 list entries; exceeded: as slots
  /// Blocks of the compressed cache: a record takes one, seldom two. Exceeded: a region is refused.
  std::uint32_t compressed_blocks = 1u << 18;
  /// Nodes hold the shown mesh, slots the decoded records, blocks the records for contacts within a round trip.
  static PoolSettings for_slots(std::uint32_t slots) noexcept {
    return {slots, slots / 4 + std::min(slots / 2 + 1024, 6144u), slots / 10 + 256, std::min(6 * slots, kMaxSlots)};
  }
  /// The most slots that fit into `bytes` with everything that belongs to them; 0 if none fits.
  static PoolSettings for_bytes(std::uint64_t bytes) noexcept;
  /// Bytes of memory with these settings, without directories.
  [[nodiscard]] std::uint64_t bytes() const noexcept;
};

struct Vertex {
  std::array<float, 3> position;  ///< model frame, file units
  VertexId id;
};

/// A face in the version that is shown. Its tree node holds a copy of the coordinates, which queries read.
struct alignas(32) FaceRow {
  std::array<Slot, 3> vertices;
  FaceId face;
  NodeIndex node;      ///< AB-tree node that holds it; kNone when not shown
  std::uint32_t last;  ///< 1: this is the finest version
};
static_assert(sizeof(FaceRow) == 32);

/// The row of face `i` (0 or 1) that slot `slot` bears.
[[nodiscard]] constexpr RowIndex row_of(Slot slot, std::uint32_t i) noexcept { return RowIndex{2 * index(slot) + i}; }

/// Size of an AB-tree node, see spm/ab_tree.hpp.
inline constexpr std::uint32_t kTreeNodeBytes = 384;
/// Leaf nodes of which the previous version can be stored in a cycle. Exceeded: refinement continues in the next.
inline constexpr std::uint32_t kKeptNodes = 1024;

/// Size of a block of the compressed cache, see spm/codec/compressed_cache.hpp.
inline constexpr std::uint32_t kCompressedBlockBytes = 20;

/// A region's list in memory: blocks of record slots, linked both ways, walked forwards to refine and backwards to
/// coarsen.
struct ListBlock {
  static constexpr std::uint32_t kEntries = 62;
  BlockIndex before, after;
  std::array<Slot, kEntries> slots;

  /// An empty list also takes a block, so that a held region always has a first block.
  [[nodiscard]] static constexpr std::uint32_t blocks_for(std::uint32_t records) noexcept {
    return records == 0 ? 1 : (records + kEntries - 1) / kEntries;
  }
};
static_assert(sizeof(ListBlock) == 256);

struct RegionList {
  BlockIndex first_block = kNone;
  std::uint32_t length = 0;
};

/// Upper bit: shown. Lower bits: the number of refined regions that want the record.
struct SlotState {
  static constexpr std::uint16_t kShown = 0x8000;
  std::uint16_t bits = 0;
  [[nodiscard]] bool shown() const noexcept { return (bits & kShown) != 0; }
  [[nodiscard]] std::uint16_t wanted() const noexcept { return bits & 0x7fff; }
};

struct Pool {
  /// Allocates and touches everything.
  explicit Pool(PoolSettings settings);

  PoolSettings settings;
  IdVector<Slot, LoadedPart> parts;
  IdVector<Slot, Vertex> vertices;
  IdVector<Slot, float> radius;  ///< of the slot's vertex, file units: see record.hpp
  IdVector<RowIndex, FaceRow> faces;
  IdVector<Slot, SlotState> state;
  IdVector<BlockIndex, ListBlock> blocks;
};

}  // namespace tactus::spm
