/// The fixed memory of an HRTC for the records, vertices, faces and tree nodes of all its objects.
///
/// A slot holds one record part, the vertex that the part adds, and the rows of the two faces that it bears. A new face
/// therefore needs no allocation. A decoded record refers to slots and rows, so a split needs no look-up. A row states
/// only where its face is shown; the coordinates of a shown face are in the AB-tree.
///
///   slot s:  parts[s]   vertices[s]   shown_at[2 s], shown_at[2 s + 1]   state[s]
///            64 B       16 B          2 x 4 B                            2 B
///
/// The loader (Cache) writes the slots of a region only while the haptic thread does not have the region. While the
/// haptic thread has it, rows and state belong to the Forest. The two rings that pass regions between the threads
/// order these accesses. The slots of a base mesh stay in use until the object is removed.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "spm/ids.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

/// With at most kMaxObjects objects, an object and a RecordId fit into a key of FlatIndex. With at most kMaxSlots
/// slots, a face row fits into CompactIndex. With at most kMaxTreeNodes nodes, a face of a node fits into LeafLane.
inline constexpr std::uint32_t kMaxSlots = 1u << 24;
inline constexpr std::uint32_t kMaxTreeNodes = 1u << 27;
inline constexpr std::uint32_t kMaxCompressedBlocks = 1u << 26;
inline constexpr std::uint32_t kMaxObjects = 64;

/// Sizes of the pool, fixed at start.
struct PoolSettings {
  std::uint32_t slots = 1u << 16;        ///< at most kMaxSlots; if none is free, a region is refused and stays coarse
  std::uint32_t tree_nodes = 1u << 14;   ///< if too few are free, refinement stops and sets the status bit PoolFull
  std::uint32_t list_blocks = 1u << 13;  ///< blocks of 82 list entries; if none is free, a region is refused
  /// Blocks of the compressed cache. A record takes one, seldom two. If none is free, a region is refused.
  std::uint32_t compressed_blocks = 1u << 18;
  /// Returns settings for `slots`. The slots are for the decoded records, the tree nodes for the shown mesh, and the
  /// compressed blocks for the regions that a probe may touch within a round trip. In a small pool most records are
  /// shown, and a shown record needs about one node.
  static PoolSettings for_slots(std::uint32_t slots) noexcept;
  /// Returns the largest settings of `for_slots` that need at most `bytes`; 0 slots if not even one fits.
  static PoolSettings for_bytes(std::uint64_t bytes) noexcept;
  /// Returns the bytes of memory that these settings need, without directories.
  [[nodiscard]] std::uint64_t bytes() const noexcept;
};

struct Vertex {
  std::array<float, 3> position;  ///< model frame, file units
  VertexId id;
};

/// The leaf of the AB-tree that shows a face, and the lane of this leaf. Both stay the same while the face is shown.
class LeafLane {
 public:
  /// The face is not shown.
  constexpr LeafLane() noexcept = default;
  constexpr LeafLane(NodeIndex leaf, unsigned lane) noexcept : bits_{index(leaf) << 3 | lane} {}
  [[nodiscard]] constexpr bool is_shown() const noexcept { return bits_ != kNone; }
  [[nodiscard]] friend constexpr bool operator==(LeafLane a, LeafLane b) noexcept = default;
  /// Tree node of level 1, and the number of the face in it. The face must be shown.
  [[nodiscard]] constexpr NodeIndex leaf() const noexcept { return NodeIndex{bits_ >> 3}; }
  [[nodiscard]] constexpr unsigned lane() const noexcept { return bits_ & 7u; }
  /// A number below eight times the number of tree nodes.
  [[nodiscard]] constexpr std::uint32_t number() const noexcept { return bits_; }

 private:
  std::uint32_t bits_ = kNone;
};
static_assert(sizeof(LeafLane) == 4);

/// Returns the row of face `i` (0 or 1) of slot `slot`.
[[nodiscard]] constexpr RowIndex row_of(Slot slot, std::uint32_t i) noexcept { return RowIndex{2 * index(slot) + i}; }
/// Returns the slot with that row.
[[nodiscard]] constexpr Slot slot_of(RowIndex row) noexcept { return Slot{index(row) / 2}; }

/// Size of an AB-tree node, see spm/ab_tree.hpp.
inline constexpr std::uint32_t kTreeNodeBytes = 320;
/// Maximum number of leaf nodes whose previous version can be stored in a cycle. If more are needed, refinement
/// continues in the next cycle.
inline constexpr std::uint32_t kMaxPreviousLeaves = 1024;

/// Size of a block of the compressed cache, see spm/codec/compressed_cache.hpp.
inline constexpr std::uint32_t kCompressedBlockBytes = 20;

/// A Slot in three bytes. It cannot be kNone.
class PackedSlot {
 public:
  constexpr PackedSlot() noexcept = default;
  constexpr PackedSlot(Slot slot) noexcept
      : bytes_{static_cast<std::uint8_t>(index(slot)), static_cast<std::uint8_t>(index(slot) >> 8),
               static_cast<std::uint8_t>(index(slot) >> 16)} {}
  [[nodiscard]] constexpr operator Slot() const noexcept {
    return Slot{std::uint32_t{bytes_[0]} | std::uint32_t{bytes_[1]} << 8 | std::uint32_t{bytes_[2]} << 16};
  }

 private:
  std::array<std::uint8_t, 3> bytes_{};
};
static_assert(PackedSlot{Slot{kMaxSlots - 1}} == Slot{kMaxSlots - 1});

/// A block of a region's list of record slots. Blocks are linked both ways: the forest walks forwards to refine and
/// backwards to coarsen.
struct ListBlock {
  static constexpr std::uint32_t kEntries = 82;
  BlockIndex before, after;
  std::array<PackedSlot, kEntries> slots;

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
  IdVector<RowIndex, LeafLane> shown_at;
  IdVector<Slot, SlotState> state;
  IdVector<BlockIndex, ListBlock> blocks;

  /// The face of a row in use, also of a base mesh.
  [[nodiscard]] BornRef born(RowIndex row) const noexcept { return parts[slot_of(row)].born[index(row) % 2]; }
  [[nodiscard]] FaceId face_of(RowIndex row) const noexcept { return born(row).face(); }
};

}  // namespace tactus::spm
