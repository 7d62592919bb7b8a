/// The loader's half of the pool. The cache stores which records of which objects are loaded, and in which slots.
///
/// The cache decodes base meshes and regions into slots: it replaces each id by the slot or row to which it refers. It
/// checks each message against the loaded records. It also stores the mesh at the loaded front, that is with all loaded
/// records applied. A record that is not loaded deforms only faces on this front. A message therefore usually names
/// only the first deformed face of a record; the other deformed faces, the parent, the third corners and the predicted
/// position follow from this face. The cache counts for each record the loaded regions that list it. When a region is
/// released, only the records that no other loaded region lists are freed, so the loaded records stay a closed set.
///
/// One thread, not the haptic one. Does not allocate after `admit`.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (local cache, loaded fronting).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "spm/compact_index.hpp"
#include "spm/free_set.hpp"
#include "spm/loaded_front.hpp"
#include "spm/model.hpp"
#include "spm/pool.hpp"
#include "spm/position_predictor.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm {

enum class AcceptResult : std::uint8_t {
  kAccepted,
  kLoaded,      ///< the region is loaded already
  kPoolFull,    ///< no slot or list block is free, or 32,767 loaded regions list a record: release regions, try again
  kIncomplete,  ///< a needed record is neither loaded nor in the message: request the region again
  kMalformed    ///< the message contradicts the model or the loaded records, or its list is not closed and in order
};

/// The faces of a base mesh in the pool, for the haptic thread. They are valid until the object is removed.
struct BaseSlots {
  struct Face {
    RowIndex row{};
    std::array<Slot, 3> corners{};
    std::uint16_t radius = 0;  ///< max radius code of the corners, see record.hpp
  };
  std::vector<Face> faces;  ///< in the order of BaseMesh::faces
};

struct CacheCounters {
  std::uint64_t records_accepted = 0;  ///< records decoded into slots
  std::uint64_t records_repeated = 0;  ///< loaded records received again
  std::uint64_t regions_released = 0;
};

class Cache {
 public:
  /// `pool` must outlive the cache. Allocates.
  explicit Cache(Pool& pool);

  /// Returns the number of slots that `admit` needs.
  [[nodiscard]] static std::uint32_t slots_for_base(const ModelSummary& summary) noexcept {
    return std::max(summary.base_vertices, (summary.base_faces + 1) / 2);
  }
  struct Admitted {
    bool fits = false;
    ObjectIndex object{};
    BaseSlots base;
  };
  /// Loads a base mesh until `remove`. `base` must have passed violations(). If the base mesh does not fit, or there
  /// are already kMaxObjects objects, `fits` is false and the cache is unchanged. The index of a removed object is
  /// reused as late as possible. Allocates.
  [[nodiscard]] Admitted admit(const BaseMesh& base);

  /// Frees the base mesh. No region of the object may be loaded, and the haptic thread must have returned the object.
  /// O(base).
  void remove(ObjectIndex object) noexcept;

  /// Loads a region: decodes its new records, increments the counts of all records in its list, and sets `list` to the
  /// list in slots. A list that differs from `expected` is malformed. If the result is not kAccepted, the cache is
  /// unchanged. O(list + sent).
  [[nodiscard]] AcceptResult accept(ObjectIndex object, const RegionData& data, const ListSummary& expected,
                                    RegionList& list) noexcept;

  /// Returns the bytes that the cache needs for an object besides the pool.
  [[nodiscard]] static std::uint64_t directory_bytes(const ModelSummary& summary) noexcept {
    return std::uint64_t{slots_for_base(summary)} * sizeof(Slot);
  }
  /// Returns the bytes that the cache needs for its table of loaded regions.
  [[nodiscard]] static std::uint64_t table_bytes(std::uint32_t list_blocks) noexcept {
    return std::uint64_t{list_blocks} * sizeof(LoadedRegion) + CompactIndex::bytes(list_blocks);
  }

  /// Unloads a region: frees its list and the records that no other loaded region lists. The haptic thread must have
  /// returned the region. O(list).
  void release(ObjectIndex object, RegionId region) noexcept;
  /// Unloads all regions of an object. O(list blocks of the pool + lists).
  void release_all(ObjectIndex object) noexcept;

  /// Numbers of slots and list blocks.
  struct Space {
    std::uint32_t slots = 0, blocks = 0;
  };
  [[nodiscard]] bool is_loaded(ObjectIndex object, RegionId region) const noexcept {
    return find(object, region) != kNone;
  }
  /// A loaded region and the first block of its list.
  struct LoadedAt {
    RegionId region = kNone;  // kNone: none
    BlockIndex block{};
  };
  /// Returns the first loaded region of an object whose list does not begin before `from`. O(list blocks of the pool).
  [[nodiscard]] LoadedAt next_loaded(ObjectIndex object, BlockIndex from) const noexcept;

  [[nodiscard]] bool has_record(ObjectIndex object, RecordId record) const noexcept {
    return index(object) < objects_.size() && find(object, record) != kNone;
  }
  [[nodiscard]] std::uint32_t slots_used() const noexcept { return free_.size() - free_.count(); }
  [[nodiscard]] std::uint32_t slots_free() const noexcept { return free_.count(); }
  [[nodiscard]] std::uint32_t blocks_free() const noexcept { return free_block_count_; }
  [[nodiscard]] const CacheCounters& counters() const noexcept { return counters_; }

  /// Returns descriptions of broken invariants. O(pool), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;

 private:
  using Front = LoadedFront<RowIndex, Slot, PackedSlot>;
  struct DecoderStore;
  struct Object {
    bool is_used = false;
    ModelSummary summary;
    IdVector<VertexId, Slot> base_slots;  // by base vertex; then the slots that only store faces
    std::uint32_t base_faces = 0;
    std::uint32_t loaded_regions = 0;
  };
  /// The region whose list begins in a block.
  struct LoadedRegion {
    RegionId region = kNone;   // kNone: no list begins in the block
    std::uint32_t length = 0;  // of the list
    ObjectIndex object{};
  };

  template <class Id>
  [[nodiscard]] static std::uint64_t key(std::uint8_t object, Id id) noexcept {
    return std::uint64_t{object} << 31 | index(id);
  }
  template <class Id>
  [[nodiscard]] static std::uint64_t key(ObjectIndex object, Id id) noexcept {
    return key(static_cast<std::uint8_t>(index(object)), id);
  }
  /// The functions that return the key of a number in `slots_` and in `rows_`.
  [[nodiscard]] auto key_of_slot() const noexcept {
    return [this](std::uint32_t number) {
      const Slot slot{number};
      return key(object_of_[slot], pool_.vertices[slot].id);
    };
  }
  [[nodiscard]] auto key_of_row() const noexcept {
    return [this](std::uint32_t number) {
      const RowIndex row{number};
      return key(object_of_[slot_of(row)], pool_.face_of(row));
    };
  }
  [[nodiscard]] auto key_of_list() const noexcept {
    return [this](std::uint32_t number) {
      const LoadedRegion& loaded = loaded_[BlockIndex{number}];
      return key(loaded.object, loaded.region);
    };
  }
  [[nodiscard]] VertexId vertex_of(ObjectIndex object, RecordId record) const noexcept {
    return VertexId{objects_[object].summary.base_vertices + index(record)};
  }
  [[nodiscard]] Slot find(ObjectIndex object, RecordId record) const noexcept {
    return Slot{slots_.find(key(object, vertex_of(object, record)), key_of_slot())};
  }
  [[nodiscard]] RowIndex find(ObjectIndex object, FaceId face) const noexcept {
    return RowIndex{rows_.find(key(object, face), key_of_row())};
  }
  /// The first block of the list of a loaded region, or kNone.
  [[nodiscard]] BlockIndex find(ObjectIndex object, RegionId region) const noexcept {
    return BlockIndex{lists_.find(key(object, region), key_of_list())};
  }
  [[nodiscard]] AcceptResult decode(ObjectIndex object, RecordId record, const RegionData& data, std::uint32_t& part,
                                    const PositionPredictor::Residuals& residuals) noexcept;
  /// Adds a record to the list that is being accepted. Returns false if it needs a vertex or face that is neither in the
  /// base mesh nor of an earlier record of the list. Otherwise a record could be freed before one that needs it.
  [[nodiscard]] bool add_to_list(Slot first_slot) noexcept;
  void free_record(ObjectIndex object, Slot first_slot) noexcept;
  void release_list(ObjectIndex number, const RegionList& list) noexcept;
  void release_region(BlockIndex first_block) noexcept;
  /// The next free slot after the last allocated one, so that neighbours in a list are neighbours in memory.
  [[nodiscard]] Slot next_slot() const noexcept { return Slot{free_.next_free(index(last_slot_))}; }
  [[nodiscard]] Slot allocate_slot() noexcept { return last_slot_ = Slot{free_.allocate(index(last_slot_))}; }

  Pool& pool_;
  IdVector<ObjectIndex, Object> objects_;
  std::uint32_t next_object_ = 0;  // index at which the search for a free one starts
  CompactIndex slots_;             // (object, VertexId) -> first slot of a loaded record
  CompactIndex rows_;              // (object, FaceId) -> row of a face of a base mesh or of a loaded record
  CompactIndex lists_;             // (object, RegionId) -> first block of the list of a loaded region
  Front front_;
  IdVector<Slot, std::uint16_t> list_counts_;  // by first slot: number of loaded regions that list the record
  IdVector<Slot, std::uint32_t> checksums_;    // by first slot: see checksum.hpp
  IdVector<Slot, std::uint8_t> object_of_;     // ObjectIndex
  IdVector<Slot, std::uint8_t> listed_in_;     // number of the last accepted list with the slot; 0: none
  std::uint8_t list_number_ = 0;               // of the list that is being accepted
  IdVector<BlockIndex, LoadedRegion> loaded_;  // by first block
  FreeSet free_;                               // slots
  Slot last_slot_{};
  std::vector<BlockIndex> free_blocks_;
  std::uint32_t free_block_count_ = 0;
  CacheCounters counters_;
};

}  // namespace tactus::spm
