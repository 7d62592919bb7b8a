/// Holds received regions in compressed form: their lists and record codes, in memory of a fixed size.
///
/// A record takes some 38 bytes in this cache, and ten times as much in the pool. So an HRTC can hold more regions than
/// the pool has slots for. The cache has the regions that a tip may touch within a round trip of the network. The
/// loader also decodes into the pool the regions that a tip will touch next. The demand lists all regions in the cache
/// as held, except the retired ones.
///
///     put           message -> blocks       counts the held regions that list each record
///     get           blocks -> RegionData    with the records that no loaded region lists
///     mark_loaded   counts the regions in the pool that list each record
///     evict         frees the list of a region, and the records that no other held region lists
///
/// Blocks are linked to chains: one chain for each record, one for each list. One thread. After `admit`, allocates only
/// for decoding: in `put` at most 50 bytes for each block.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "spm/codec/received_records.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/flat_index.hpp"
#include "spm/model.hpp"
#include "spm/pool.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm::codec {

class CompressedCache {
 public:
  /// Allocates the memory of all blocks and writes to each page of it.
  explicit CompressedCache(std::uint32_t blocks);

  /// Adds an object with its number in Cache. `summary` and `tables` must remain valid until `remove`. Allocates.
  void admit(ObjectIndex object, const ModelSummary& summary, const RecordTables& tables);
  /// Removes an object of which no region is held.
  void remove(ObjectIndex object) noexcept { objects_[object].reset(); }

  struct PutResult {
    enum class Status : std::uint8_t {
      kStored,
      kAlreadyHeld,
      kFull,        ///< too few blocks, or a record is in the lists of 65,535 regions: evict regions and try again
      kIncomplete,  ///< a record of the list is neither in the cache nor in the message
      kMalformed    ///< `error` says why
    };
    Status status = Status::kMalformed;
    std::uint32_t records = 0;             ///< number of records in the message
    std::uint32_t returned = 0;            ///< number of these records that were received before (ReceivedRecords)
    std::uint32_t repeated = 0;            ///< number of these records that were already in the cache
    std::uint32_t repeated_unretired = 0;  ///< number of repeated records in the list of a region that is not retired
    /// Number of blocks that the region took, or needs if the status is kFull. blocks() + 1 if it can never fit.
    std::uint32_t blocks = 0;
    std::uint32_t blocks_if_empty = 0;  ///< number of blocks that list and message would take in an empty cache
    std::string error;
  };
  /// Stores a message with this region. If the status is not kStored, the cache is unchanged. Checks the message; if
  /// its list has more records than the cache has blocks, returns kFull and does not check the rest. O(list + message).
  [[nodiscard]] PutResult put(ObjectIndex object, RegionId region, std::span<const std::uint8_t> message);

  [[nodiscard]] bool holds(ObjectIndex object, RegionId region) const noexcept {
    return index_.find(key_of(object, region)) != kNone;
  }
  /// Returns the list of a held region, and the records of the list that are in the list of no loaded region. Returns
  /// null if the bits of a record are damaged. The result is valid until the next call.
  [[nodiscard]] const RegionData* get(ObjectIndex object, RegionId region);
  /// Marks a held region as loaded into the pool, so that `get` of another region omits its records. O(list).
  void mark_loaded(ObjectIndex object, RegionId region) noexcept;
  /// Revokes `mark_loaded`. Call it before the region leaves the pool or is evicted. O(list).
  void mark_unloaded(ObjectIndex object, RegionId region) noexcept;

  /// Marks a held region as retired; `get` still works. O(list).
  void retire(ObjectIndex object, RegionId region) noexcept;
  /// Revokes `retire`. O(list).
  void reinstate(ObjectIndex object, RegionId region) noexcept;
  /// Removes a retired region and frees the blocks that no other region needs. O(list).
  void evict(ObjectIndex object, RegionId region) noexcept;

  [[nodiscard]] std::uint32_t blocks() const noexcept { return static_cast<std::uint32_t>(blocks_.size()); }
  [[nodiscard]] std::uint32_t blocks_free() const noexcept { return free_blocks_; }
  /// Number of blocks that become free if all retired regions are evicted.
  [[nodiscard]] std::uint32_t blocks_retired() const noexcept { return retired_blocks_; }

  /// Returns descriptions of broken invariants. O(blocks), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations();

 private:
  static constexpr std::size_t kPayloadBytes = 16;
  static constexpr unsigned kAnchorBits = 30;
  struct Block {
    std::uint32_t next;
    std::array<std::uint8_t, kPayloadBytes> bytes;
  };
  static_assert(sizeof(Block) == kCompressedBlockBytes);
  static_assert(kMaxFaces <= 1u << kAnchorBits);
  struct Object {
    const ModelSummary* summary;
    const RecordTables* tables;
    ReceivedRecords received;
  };

  [[nodiscard]] static std::uint64_t key(ObjectIndex object, RecordId record) noexcept {
    return std::uint64_t{index(object)} << 31 | index(record);
  }
  /// In the keys, regions are numbered after the records. violations() of the base mesh limits the sum of both.
  [[nodiscard]] std::uint64_t key_of(ObjectIndex object, RegionId region) const noexcept {
    return key(object, RecordId{objects_[object]->summary->records + index(region)});
  }
  [[nodiscard]] static std::uint32_t blocks_for(std::uint64_t bits) noexcept {
    return static_cast<std::uint32_t>((bits + 8 * kPayloadBytes - 1) / (8 * kPayloadBytes));
  }
  /// Copies `bytes` to free blocks and returns the first block of the chain.
  [[nodiscard]] std::uint32_t write_chain(const Bytes& bytes) noexcept;
  void free_chain(std::uint32_t first) noexcept;
  /// Copies a chain to `buffer_`.
  void read_chain(std::uint32_t first);
  /// Decodes the list of a held region to `list_`.
  void read_list(ObjectIndex object, RegionId region);
  /// Number of blocks of a chain.
  [[nodiscard]] std::uint32_t chain_length(std::uint32_t first) const noexcept;
  /// Calls `visit` with the key and the first block of each record of `list_`.
  template <class Visit>
  void for_each_listed(ObjectIndex object, Visit visit) const;

  std::vector<Block> blocks_;
  std::vector<std::uint16_t> lists_with_;            // by first block of a record: number of regions that list it
  std::vector<std::uint16_t> unretired_lists_with_;  // number of these regions that are not retired
  std::vector<std::uint16_t> loaded_lists_with_;     // number of these regions that are marked as loaded
  FlatIndex index_;                                  // record or region -> first block
  std::uint32_t first_free_ = kNone, free_blocks_, retired_blocks_ = 0;
  IdVector<ObjectIndex, std::optional<Object>> objects_;
  std::vector<std::uint8_t> buffer_;
  std::vector<Interval> list_;
  RegionData data_;
};

}  // namespace tactus::spm::codec
