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
  /// list in slots. If the result is not kAccepted, the cache is unchanged. O(list + sent).
  [[nodiscard]] AcceptResult accept(ObjectIndex object, const RegionData& data, RegionList& list) noexcept;

  /// Returns the bytes that the cache needs for the base mesh of an object and for all its regions, loaded or not.
  [[nodiscard]] static std::uint64_t directory_bytes(const ModelSummary& summary) noexcept {
    return std::uint64_t{slots_for_base(summary)} * sizeof(Slot) +
           std::uint64_t{summary.regions} * 3 * sizeof(std::uint32_t);
  }

  /// Unloads a region: frees its list and the records that no other loaded region lists. The haptic thread must have
  /// returned the region. O(list).
  void release(ObjectIndex object, RegionId region) noexcept;

  /// Numbers of slots and list blocks.
  struct Space {
    std::uint32_t slots = 0, blocks = 0;
  };
  [[nodiscard]] bool is_loaded(ObjectIndex object, RegionId region) const noexcept;

  [[nodiscard]] bool has_record(ObjectIndex object, RecordId record) const noexcept {
    return index(object) < objects_.size() && find(object, record) != kNone;
  }
  /// The length of the region's list, loaded or not.
  [[nodiscard]] std::uint32_t records_of(ObjectIndex object, RegionId region) const noexcept {
    return objects_[object].record_counts[region];
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
    IdVector<RegionId, std::uint32_t> record_counts;  // length of the region's list
    IdVector<RegionId, std::uint32_t> checksums;      // sum of the checksums of the region's records
    IdVector<RegionId, BlockIndex> first_blocks;      // first block of the list; kNone if the region is not loaded
    [[nodiscard]] RegionList list(RegionId region) const noexcept {
      return {first_blocks[region], record_counts[region]};
    }
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
  [[nodiscard]] VertexId vertex_of(ObjectIndex object, RecordId record) const noexcept {
    return VertexId{objects_[object].summary.base_vertices + index(record)};
  }
  [[nodiscard]] Slot find(ObjectIndex object, RecordId record) const noexcept {
    return Slot{slots_.find(key(object, vertex_of(object, record)), key_of_slot())};
  }
  [[nodiscard]] RowIndex find(ObjectIndex object, FaceId face) const noexcept {
    return RowIndex{rows_.find(key(object, face), key_of_row())};
  }
  [[nodiscard]] AcceptResult decode(ObjectIndex object, RecordId record, const RegionData& data, std::uint32_t& part,
                                    const PositionPredictor::Residuals& residuals) noexcept;
  /// Adds a record to the list that is being accepted. Returns false if it needs a vertex or face that is neither in the
  /// base mesh nor of an earlier record of the list. Otherwise a record could be freed before one that needs it.
  [[nodiscard]] bool add_to_list(Slot first_slot) noexcept;
  void free_record(ObjectIndex object, Slot first_slot) noexcept;
  void release_list(ObjectIndex number, const RegionList& list) noexcept;
  /// The next free slot after the last allocated one, so that neighbours in a list are neighbours in memory.
  [[nodiscard]] Slot next_slot() const noexcept { return Slot{free_.next_free(index(last_slot_))}; }
  [[nodiscard]] Slot allocate_slot() noexcept { return last_slot_ = Slot{free_.allocate(index(last_slot_))}; }

  Pool& pool_;
  IdVector<ObjectIndex, Object> objects_;
  std::uint32_t next_object_ = 0;  // index at which the search for a free one starts
  CompactIndex slots_;             // (object, VertexId) -> first slot of a loaded record
  CompactIndex rows_;              // (object, FaceId) -> row of a face of a base mesh or of a loaded record
  Front front_;
  IdVector<Slot, std::uint16_t> list_counts_;  // by first slot: number of loaded regions that list the record
  IdVector<Slot, std::uint32_t> checksums_;    // by first slot: see checksum.hpp
  IdVector<Slot, std::uint8_t> object_of_;     // ObjectIndex
  IdVector<Slot, std::uint8_t> listed_in_;     // number of the last accepted list with the slot; 0: none
  std::uint8_t list_number_ = 0;               // of the list that is being accepted
  FreeSet free_;                               // slots
  Slot last_slot_{};
  std::vector<BlockIndex> free_blocks_;
  std::uint32_t free_block_count_ = 0;
  CacheCounters counters_;
};

}  // namespace tactus::spm
