/// The one fixed store of a controller: records, vertices, faces and tree nodes of all its objects.
///
/// A slot holds one record part, the vertex it brings and rows for the two faces it bears. A face that appears
/// therefore needs no allocation of its own, and a record, once decoded, reaches everything it changes without a
/// look-up.
///
///   slot s:  parts[s]   vertices[s]   radius[s]   faces[2 s], faces[2 s + 1]   state[s]
///            64 B       16 B          4 B         2 x 32 B                     2 B
///
/// Who may write: the loader (Cache) fills a slot before it hands a region over and after it got the region back;
/// between the two, faces and state belong to the haptic thread (Forest). The rings that carry the regions order the
/// accesses. The base mesh takes slots that are never given back.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "spm/ids.hpp"
#include "spm/record.hpp"

namespace tactus::spm {

/// What names a thing of one pool fits a key of FlatIndex, and a face row its number.
inline constexpr std::uint32_t kMaxSlots = 1u << 26;
inline constexpr std::uint32_t kMaxObjects = 64;

/// Sized once, at start. `slots` and `tree_nodes` are what an operator sets; the rest follows.
struct PoolSettings {
  std::uint32_t slots = 1u << 16;        ///< at most kMaxSlots; exceeded: a region is refused and stays coarse
  std::uint32_t tree_nodes = 1u << 14;   ///< exceeded: refinement stops, PoolFull is flagged
  std::uint32_t list_blocks = 1u << 13;  ///< blocks of 62 list entries; exceeded: as slots
  /// Beside the pool, for what is kept as it came: a record takes one, seldom two. Exceeded: a region is refused.
  std::uint32_t compressed_blocks = 1u << 18;
  /// Nodes follow what is shown, slots what is decoded, blocks what may be met within a round trip.
  static PoolSettings for_slots(std::uint32_t slots) noexcept {
    return {slots, slots / 4 + std::min(slots / 2 + 1024, 6144u), slots / 10 + 256, std::min(6 * slots, kMaxSlots)};
  }
  /// As many slots as `bytes` hold, all that belongs to them included; 0 when not even one fits.
  static PoolSettings for_bytes(std::uint64_t bytes) noexcept;
  /// Bytes that a controller with these settings holds for its models, directories apart.
  [[nodiscard]] std::uint64_t bytes() const noexcept;
};

struct Vertex {
  std::array<float, 3> position;  ///< model frame, file units
  std::uint32_t id;               ///< VertexId
};

/// A face in whatever version is shown. Its coordinates stand in the tree node that holds it, where queries read them.
struct alignas(32) FaceRow {
  std::array<std::uint32_t, 3> vertices;  ///< slots
  std::uint32_t face;                     ///< FaceId
  std::uint32_t node;                     ///< AB-tree node that holds it; kNone when not shown
  std::uint32_t last;                     ///< 1: this is the finest version
};
static_assert(sizeof(FaceRow) == 32);

/// Size of an AB-tree node, see spm/ab_tree.hpp.
inline constexpr std::uint32_t kTreeNodeBytes = 384;
/// Leaf nodes that may change in a cycle while they are kept as they were. Exceeded: refinement goes on in the next.
inline constexpr std::uint32_t kKeptNodes = 1024;

/// Size of a block of what is kept coded, see spm/codec/compressed_cache.hpp.
inline constexpr std::uint32_t kCompressedBlockBytes = 20;

/// A region's list in memory: blocks of record slots, linked both ways, walked forwards to refine and backwards to
/// coarsen.
struct ListBlock {
  static constexpr std::uint32_t kEntries = 62;
  std::uint32_t before, after;
  std::array<std::uint32_t, kEntries> slots;

  /// An empty list takes one too, so that "held" is visible.
  [[nodiscard]] static constexpr std::uint32_t blocks_for(std::uint32_t records) noexcept {
    return records == 0 ? 1 : (records + kEntries - 1) / kEntries;
  }
};
static_assert(sizeof(ListBlock) == 256);

struct RegionList {
  std::uint32_t first_block = kNone;
  std::uint32_t length = 0;
};

/// Upper bit: shown; lower bits: how many regions under refinement want the record.
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
  std::vector<RecordPart> parts;
  std::vector<Vertex> vertices;
  std::vector<float> radius;  ///< of the slot's vertex, file units: see record.hpp
  std::vector<FaceRow> faces;
  std::vector<SlotState> state;
  std::vector<ListBlock> blocks;
};

}  // namespace tactus::spm
