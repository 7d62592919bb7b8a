/// The fixed memory of an HRTC for the records, vertices, faces and tree nodes of all its objects.
///
/// A slot holds one record part, the vertex that the part adds, and the rows of the two faces that it bears. A new face
/// therefore needs no allocation. A decoded record refers to slots and rows, so a split needs no look-up.
///
///   slot s:  parts[s]   vertices[s]   radius[s]   faces[2 s], faces[2 s + 1]   state[s]
///            64 B       16 B          4 B         2 x 32 B                     2 B
///
/// The loader (Cache) writes the slots of a region only while the haptic thread does not have the region. While the
/// haptic thread has it, faces and state belong to the Forest. The two rings that pass regions between the threads
/// order these accesses. The slots of a base mesh stay in use until the object is removed.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "spm/ids.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

/// Within these limits, an object and a RecordId fit into a key of FlatIndex, and a face row fits into a value.
inline constexpr std::uint32_t kMaxSlots = 1u << 26;
inline constexpr std::uint32_t kMaxObjects = 64;

/// Sizes of the pool, fixed at start.
struct PoolSettings {
  std::uint32_t slots = 1u << 16;        ///< at most kMaxSlots; if none is free, a region is refused and stays coarse
  std::uint32_t tree_nodes = 1u << 14;   ///< if too few are free, refinement stops and sets the status bit PoolFull
  std::uint32_t list_blocks = 1u << 13;  ///< blocks of 62 list entries; if none is free, a region is refused
  /// Blocks of the compressed cache. A record takes one, seldom two. If none is free, a region is refused.
  std::uint32_t compressed_blocks = 1u << 18;
  /// Returns settings in proportion to `slots`. The slots are for the decoded records, the tree nodes for the shown
  /// mesh, and the compressed blocks for the regions that a probe may touch within a round trip.
  static PoolSettings for_slots(std::uint32_t slots) noexcept {
    return {slots, slots / 4 + std::min(slots / 2 + 1024, 6144u), slots / 10 + 256, std::min(6 * slots, kMaxSlots)};
  }
  /// Returns the largest settings of `for_slots` that need at most `bytes`; 0 slots if not even one fits.
  static PoolSettings for_bytes(std::uint64_t bytes) noexcept;
  /// Returns the bytes of memory that these settings need, without directories.
  [[nodiscard]] std::uint64_t bytes() const noexcept;
};

struct Vertex {
  std::array<float, 3> position;  ///< model frame, file units
  VertexId id;
};

/// A face in its shown version. Queries read a copy of the coordinates in the tree node.
struct alignas(32) FaceRow {
  std::array<Slot, 3> vertices;
  FaceId face;
  NodeIndex node;        ///< AB-tree node with the face; kNone if the face is not shown
  std::uint32_t finest;  ///< 1 if the shown version is the finest, else 0
};
static_assert(sizeof(FaceRow) == 32);

/// Returns the row of face `i` (0 or 1) of slot `slot`.
[[nodiscard]] constexpr RowIndex row_of(Slot slot, std::uint32_t i) noexcept { return RowIndex{2 * index(slot) + i}; }
/// Returns the slot with that row.
[[nodiscard]] constexpr Slot slot_of(RowIndex row) noexcept { return Slot{index(row) / 2}; }

/// Size of an AB-tree node, see spm/ab_tree.hpp.
inline constexpr std::uint32_t kTreeNodeBytes = 384;
/// Maximum number of leaf nodes whose previous version can be stored in a cycle. If more are needed, refinement
/// continues in the next cycle.
inline constexpr std::uint32_t kMaxPreviousLeaves = 1024;

/// Size of a block of the compressed cache, see spm/codec/compressed_cache.hpp.
inline constexpr std::uint32_t kCompressedBlockBytes = 20;

/// A block of a region's list of record slots. Blocks are linked both ways: the forest walks forwards to refine and
/// backwards to coarsen.
struct ListBlock {
  static constexpr std::uint32_t kEntries = 62;
  BlockIndex before, after;
  std::array<Slot, kEntries> slots;

  /// Returns the number of blocks of a list. An empty list also takes a block, so that a loaded region always has one.
  [[nodiscard]] static constexpr std::uint32_t blocks_for(std::uint32_t records) noexcept {
    return records == 0 ? 1 : (records + kEntries - 1) / kEntries;
  }
};
static_assert(sizeof(ListBlock) == 256);

struct RegionList {
  BlockIndex first_block = kNone;
  std::uint32_t length = 0;
};

/// The highest bit states whether the record is shown. The other bits count the applied list entries of the record.
struct SlotState {
  static constexpr std::uint16_t kShown = 0x8000;
  std::uint16_t bits = 0;
  [[nodiscard]] bool shown() const noexcept { return (bits & kShown) != 0; }
  [[nodiscard]] std::uint16_t wanted() const noexcept { return bits & 0x7fff; }
};

struct Pool {
  /// Allocates all memory and writes to it once, so that later accesses cause no page fault.
  explicit Pool(PoolSettings settings);

  PoolSettings settings;
  IdVector<Slot, LoadedPart> parts;
  IdVector<Slot, Vertex> vertices;
  IdVector<Slot, float> radius;  ///< radius of the slot's vertex in file units, see record.hpp
  IdVector<RowIndex, FaceRow> faces;
  IdVector<Slot, SlotState> state;
  IdVector<BlockIndex, ListBlock> blocks;
};

}  // namespace tactus::spm
