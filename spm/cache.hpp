/// The loader's half of the pool: which records of which objects are loaded, and in which slots.
///
/// The cache takes base meshes and regions in ids and decodes them into slots. It also stores the mesh at the loaded
/// front. A record that is not loaded deforms only faces that are on this front, so all of its deformed faces but the
/// first, its parent, its third corners and its position follow from the first face. The cache counts for each record
/// how many held regions list it. So releasing a region frees the records that no other region lists, and never breaks
/// a closed set. Everything that arrives is checked against what is loaded.
///
/// One thread, not the haptic one. Does not allocate after `admit`.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (local cache, loaded fronting).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "spm/flat_index.hpp"
#include "spm/free_set.hpp"
#include "spm/loaded_front.hpp"
#include "spm/model.hpp"
#include "spm/pool.hpp"
#include "spm/position_predictor.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm {

enum class AcceptResult : std::uint8_t {
  kAccepted,
  kHeld,        ///< the region is held already
  kPoolFull,    ///< no slot or list block is free, or 32,767 held lists have a record: release regions and try again
  kIncomplete,  ///< needs a record that is neither loaded nor in the message: request the region again
  kMalformed    ///< contradicts the model or the loaded records, or its list is not closed
};

/// The base mesh in slots, for the haptic thread.
struct BaseSlots {
  std::vector<RowIndex> faces;  ///< in FaceId order of the base; filled and pinned
};

struct CacheCounters {
  std::uint64_t records_accepted = 0;  ///< decoded into slots
  std::uint64_t records_repeated = 0;  ///< received again while loaded
  std::uint64_t regions_released = 0;
};

class Cache {
 public:
  /// `pool` must outlive the cache. Allocates.
  explicit Cache(Pool& pool);

  /// Slots that `admit` needs.
  [[nodiscard]] static std::uint32_t slots_for_base(const BaseMesh& base) noexcept;
  /// Loads a base mesh, which must have passed violations(), until `remove`. If it does not fit, or the cache has
  /// kMaxObjects objects, `fits` is false and nothing has changed. A removed number is used again as late as possible.
  /// Allocates.
  struct Admitted {
    bool fits = false;
    ObjectIndex object{};
    BaseSlots base;
  };
  [[nodiscard]] Admitted admit(const BaseMesh& base);

  /// Frees the base mesh. No region of the object may be held, and the haptic thread must have given it back. O(base).
  void remove(ObjectIndex object) noexcept;

  /// Decodes the new records, counts all records of the list, and sets `list` to the list in slots. If the result is
  /// not kAccepted, the cache is unchanged. O(list + sent).
  [[nodiscard]] AcceptResult accept(ObjectIndex object, const RegionData& data, RegionList& list) noexcept;

  /// Bytes that the cache needs for an object's regions, held or not.
  [[nodiscard]] static std::uint64_t directory_bytes(const ModelSummary& summary) noexcept {
    return std::uint64_t{summary.regions} * 3 * sizeof(std::uint32_t);
  }

  /// Frees the region's list and the records that no other held region lists. The haptic thread must have returned the
  /// region. O(list).
  void release(ObjectIndex object, RegionId region) noexcept;

  /// Slots and blocks that `release` would free now. Neighbours that share records make it less. O(list).
  struct Room {
    std::uint32_t slots = 0, blocks = 0;
  };
  [[nodiscard]] Room room_of(ObjectIndex object, RegionId region) const noexcept;

  [[nodiscard]] bool holds(ObjectIndex object, RegionId region) const noexcept;
  /// Whether the record has a slot.
  [[nodiscard]] bool has(ObjectIndex object, RecordId record) const noexcept {
    return records_.find(key(object, record)) != kNone;
  }
  /// Length of the region's list, held or not.
  [[nodiscard]] std::uint32_t records_of(ObjectIndex object, RegionId region) const noexcept {
    return objects_[object].record_counts[region];
  }
  [[nodiscard]] std::uint32_t slots_used() const noexcept { return free_.size() - free_.count(); }
  [[nodiscard]] std::uint32_t slots_free() const noexcept { return free_.count(); }
  [[nodiscard]] std::uint32_t blocks_free() const noexcept { return free_block_count_; }
  [[nodiscard]] const CacheCounters& counters() const noexcept { return counters_; }

  /// Broken invariants. O(pool), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;

 private:
  using Front = LoadedFront<RowIndex, Slot>;
  struct DecoderStore;
  struct Object {
    bool here = false;
    ModelSummary summary;
    IdVector<VertexId, Slot> base_slots;  // by base vertex, then the slots that only store faces
    std::uint32_t base_faces = 0;
    IdVector<RegionId, std::uint32_t> record_counts;  // length of the region's list
    IdVector<RegionId, std::uint32_t> checksums;      // sum of the checksums of its records
    IdVector<RegionId, BlockIndex> first_blocks;      // of its list; kNone if the region is not held
    [[nodiscard]] RegionList list(RegionId region) const noexcept {
      return {first_blocks[region], record_counts[region]};
    }
  };

  template <class Id>
  [[nodiscard]] static std::uint64_t key(ObjectIndex object, Id id) noexcept {
    return std::uint64_t{index(object)} << 31 | index(id);
  }
  [[nodiscard]] Slot find(ObjectIndex object, RecordId record) const noexcept {
    return Slot{records_.find(key(object, record))};
  }
  [[nodiscard]] AcceptResult decode(ObjectIndex object, RecordId record, const RegionData& data, std::uint32_t& part,
                                    const PositionPredictor::Residuals& residuals) noexcept;
  void forget(ObjectIndex object, Slot first_slot) noexcept;
  void release_list(ObjectIndex number, const RegionList& list) noexcept;
  /// The next free slot after the one taken last, so that neighbours in a list are neighbours in memory.
  [[nodiscard]] Slot next_slot() const noexcept { return Slot{free_.next(index(taken_last_))}; }
  [[nodiscard]] Slot take_slot() noexcept { return taken_last_ = Slot{free_.take(index(taken_last_))}; }

  Pool& pool_;
  IdVector<ObjectIndex, Object> objects_;
  std::uint32_t next_object_ = 0;  // where the search for a free number starts
  FlatIndex records_;              // (object, RecordId) -> first slot
  FlatIndex faces_;                // (object, FaceId) -> face row, of every face borne by a held record or the base
  Front front_;
  IdVector<Slot, std::uint16_t> loaded_;     // by first slot: held lists with the record
  IdVector<Slot, std::uint32_t> checksums_;  // by first slot: see checksum.hpp
  FreeSet free_;                             // slots
  Slot taken_last_{};
  std::vector<BlockIndex> free_blocks_;
  std::uint32_t free_block_count_ = 0;
  CacheCounters counters_;
};

}  // namespace tactus::spm
