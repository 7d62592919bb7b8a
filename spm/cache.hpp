/// The loader's half of the pool: which records of which objects are here, and in which slots.
///
/// Takes base meshes and regions in ids, gives slots; the one place where ids become slots. Keeps the mesh at the
/// loaded front: a record that is not held deforms just what stands there, so that all but one of the faces that it
/// deforms, its parent, third corners and place follow from the first. Counts for each record how many held regions
/// list it (the loaded front), so that releasing a region frees what no other needs and never breaks a closure. One
/// thread, not the haptic one. Does not allocate after `admit`. Everything that arrives is checked against what is
/// held. Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (local cache, loaded fronting).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "spm/flat_index.hpp"
#include "spm/free_set.hpp"
#include "spm/loaded_front.hpp"
#include "spm/model.hpp"
#include "spm/pool.hpp"
#include "spm/region_data.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

/// Number of an object within one controller, below kMaxObjects.
enum class ObjectIndex : std::uint32_t {};

enum class AcceptResult : std::uint8_t {
  kAccepted,
  kHeld,        ///< the region is here already
  kPoolFull,    ///< no slot or list block left, or a record is in 32,767 held lists: release something and ask again
  kIncomplete,  ///< a record it depends on is neither here nor in the message: ask again
  kMalformed    ///< contradicts the model or what is held, or a record's needs are not in the list
};

/// The base mesh in slots, for the haptic thread.
struct BaseSlots {
  std::vector<std::uint32_t> faces;  ///< face rows, in FaceId order of the base; filled and pinned
};

struct CacheCounters {
  std::uint64_t records_accepted = 0;  ///< decoded into slots
  std::uint64_t records_repeated = 0;  ///< came although they were here
  std::uint64_t regions_released = 0;
};

class Cache {
 public:
  /// `pool` must outlive the cache. Allocates.
  explicit Cache(Pool& pool);

  /// What `admit` would take.
  [[nodiscard]] static std::uint32_t slots_for_base(const BaseMesh& base) noexcept;
  /// Pins the base mesh. When it does not fit, `fits` is false and nothing has changed.
  /// `base` must have passed violations(). Allocates.
  struct Admitted {
    bool fits = false;
    ObjectIndex object{};
    BaseSlots base;
  };
  [[nodiscard]] Admitted admit(const BaseMesh& base);

  /// Decodes what is new, counts the whole list as loaded and writes it to `list` in slots. Anything but kAccepted
  /// leaves the cache as it was. O(list + sent).
  [[nodiscard]] AcceptResult accept(ObjectIndex object, const RegionData& data, RegionList& list) noexcept;

  /// What an object's regions take here, whatever of them is held.
  [[nodiscard]] static std::uint64_t directory_bytes(const ModelSummary& summary) noexcept {
    return std::uint64_t{summary.regions} * 3 * sizeof(std::uint32_t);
  }

  /// Frees the region's list and what only it needed. The haptic thread must have given the region back. O(list).
  void release(ObjectIndex object, RegionId region) noexcept;

  /// What releasing the region now would give back; more once neighbours that share its records are gone. O(list).
  struct Room {
    std::uint32_t slots = 0, blocks = 0;
  };
  [[nodiscard]] Room room_of(ObjectIndex object, RegionId region) const noexcept;

  [[nodiscard]] bool holds(ObjectIndex object, RegionId region) const noexcept;
  /// Whether the record has a slot.
  [[nodiscard]] bool has(ObjectIndex object, std::uint32_t record) const noexcept {
    return records_.find(key(object, record)) != kNone;
  }
  /// Length of the region's list, held or not.
  [[nodiscard]] std::uint32_t records_of(ObjectIndex object, RegionId region) const noexcept {
    return objects_[index(object)].record_counts[index(region)];
  }
  [[nodiscard]] std::uint32_t slots_used() const noexcept { return free_.size() - free_.count(); }
  [[nodiscard]] std::uint32_t slots_free() const noexcept { return free_.count(); }
  [[nodiscard]] std::uint32_t blocks_free() const noexcept { return free_block_count_; }
  [[nodiscard]] const CacheCounters& counters() const noexcept { return counters_; }

  /// What is broken, in words. O(pool), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;

 private:
  /// What is known of a record while its parts come in.
  struct Entered {
    VertexRing ring;
    LoadedFront::Split faces;
    LoadedFront::At last{kNone, 0};  // deformed
  };
  struct Object {
    ModelSummary summary;
    std::vector<std::uint32_t> base_slots;     // by base VertexId
    std::vector<std::uint32_t> record_counts;  // by region: what its list must add up to
    std::vector<std::uint32_t> checksums;      // by region: what those of its records must add up to
    std::vector<std::uint32_t> first_blocks;   // by region: of its list; kNone when not held
    [[nodiscard]] RegionList list(RegionId region) const noexcept {
      return {first_blocks[index(region)], record_counts[index(region)]};
    }
  };

  [[nodiscard]] static std::uint64_t key(ObjectIndex object, std::uint32_t id) noexcept {
    return std::uint64_t{index(object)} << 31 | id;
  }
  [[nodiscard]] std::uint32_t slot_of_vertex(const Object& object, ObjectIndex number,
                                             std::uint32_t vertex) const noexcept;
  [[nodiscard]] AcceptResult decode(ObjectIndex number, std::uint32_t record, const RegionData& data,
                                    std::uint32_t& part, const std::array<std::uint32_t, 3>& offset) noexcept;
  [[nodiscard]] AcceptResult enter_deformed(ObjectIndex number, const RecordPart& source, std::uint32_t u,
                                            RecordPart& target, Entered& entered) noexcept;
  [[nodiscard]] AcceptResult enter_born(ObjectIndex number, const RecordPart& source, std::uint32_t u,
                                        std::uint32_t slot, Entered& entered) noexcept;
  [[nodiscard]] bool place(const Object& object, const VertexRing& ring, const std::array<std::uint32_t, 3>& offset,
                           std::array<float, 3>& position) const noexcept;
  void forget(ObjectIndex number, std::uint32_t first_slot) noexcept;
  void release_list(ObjectIndex number, const RegionList& list) noexcept;
  /// The slot that is taken next: beside the one before, so that neighbours in a list are neighbours in memory.
  [[nodiscard]] std::uint32_t next_slot() const noexcept { return free_.next(taken_last_); }
  [[nodiscard]] std::uint32_t take_slot() noexcept { return taken_last_ = free_.take(taken_last_); }

  Pool& pool_;
  std::vector<Object> objects_;
  FlatIndex records_;                  // (object, RecordId) -> first slot
  FlatIndex faces_;                    // (object, FaceId) -> face row, of every face borne by a held record or the base
  LoadedFront front_;                  // by face row
  std::vector<std::uint16_t> loaded_;  // by first slot
  std::vector<std::uint32_t> checksums_;  // by first slot: see seal.hpp
  FreeSet free_;                          // slots
  std::uint32_t taken_last_ = 0;          // of them
  std::vector<std::uint32_t> free_blocks_;
  std::uint32_t free_block_count_ = 0;
  CacheCounters counters_;
};

}  // namespace tactus::spm
