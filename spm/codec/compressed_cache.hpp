/// Received regions in their compressed form: lists and record codes, in memory of a fixed size.
///
/// A record takes some 38 bytes here, in the pool ten times as much. So an HRTC holds more regions than it can show:
/// those that a tip may touch within a round trip of the network are here, and those that it will touch in the next
/// moments are also decoded into the pool. The demand lists the regions here as held.
///
///     put      message -> blocks       counts for each record how many regions here list it
///     get      blocks -> RegionData    with those of the records that the pool lacks
///     release  frees the list, and the records that no other region here lists
///
/// Blocks are linked to chains: one chain for a record, one for a list. One thread. After `admit`, allocates only for
/// decoding.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "spm/cache.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/codec/record_reader.hpp"
#include "spm/flat_index.hpp"
#include "spm/model.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm::codec {

class CompressedCache {
 public:
  /// Allocates and touches everything.
  explicit CompressedCache(std::uint32_t blocks);

  /// `object`: its number in Cache. Both other arguments must outlive the object. Allocates a bit for each record.
  void admit(ObjectIndex object, const ModelSummary& summary, const RecordTables& tables);
  /// Removes an object of which no region is held.
  void remove(ObjectIndex object) noexcept { objects_[object].reset(); }

  struct Put {
    enum class Status : std::uint8_t {
      kKept,
      kHere,        ///< the region is here already
      kFull,        ///< `blocks` are needed: release regions and try again
      kIncomplete,  ///< a record of the list is neither here nor in the message
      kMalformed    ///< `error` says why
    };
    Status status = Status::kMalformed;
    std::uint32_t records = 0;    ///< in the message
    std::uint32_t returned = 0;   ///< of these, records that are or were here
    std::uint32_t repeated = 0;   ///< of these, records that are here
    std::uint32_t published = 0;  ///< of these, records of regions that stay, which the demand lists as held
    std::uint32_t blocks = 0;     ///< taken, or needed
    std::uint32_t whole = 0;      ///< blocks for list and records of the message in an empty cache
    std::string error;
  };
  /// Stores a message with this region. If the result is not kKept, the cache is unchanged. O(list + message). Decodes
  /// the message as a check and drops the result.
  [[nodiscard]] Put put(ObjectIndex object, RegionId region, std::span<const std::uint8_t> message);

  [[nodiscard]] bool keeps(ObjectIndex object, RegionId region) const noexcept {
    return index_.find(key_of(object, region)) != kNone;
  }
  /// The list of a region that is here, and those of its records that have no slot in `cache`.
  [[nodiscard]] const RegionData& get(ObjectIndex object, RegionId region, const Cache& cache);

  /// Marks a region as leaving. It remains usable; blocks that only leaving regions need count as leaving. O(list).
  void leave(ObjectIndex object, RegionId region) noexcept;
  /// Revokes `leave`. O(list).
  void stay(ObjectIndex object, RegionId region) noexcept;
  /// Frees the blocks that only this region needs. The region must be leaving. O(list).
  void release(ObjectIndex object, RegionId region) noexcept;

  [[nodiscard]] std::uint32_t blocks() const noexcept { return static_cast<std::uint32_t>(blocks_.size()); }
  [[nodiscard]] std::uint32_t blocks_free() const noexcept { return free_; }
  /// Blocks that are free once all leaving regions are released.
  [[nodiscard]] std::uint32_t blocks_leaving() const noexcept { return leaving_; }

  /// Broken invariants. O(blocks), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations();

 private:
  static constexpr std::size_t kPayload = 16;
  static constexpr unsigned kAnchorBits = 28;
  struct Block {
    std::uint32_t next;
    std::array<std::uint8_t, kPayload> bytes;
  };
  static_assert(sizeof(Block) == kCompressedBlockBytes);
  static_assert(kMaxFaces <= 1u << kAnchorBits);
  struct Object {
    const ModelSummary* summary;
    RecordReader reader;
    const RecordTables* tables;
    IdVector<RecordId, bool> seen;  // has been received before
  };

  [[nodiscard]] static std::uint64_t key(ObjectIndex object, RecordId record) noexcept {
    return std::uint64_t{index(object)} << 31 | index(record);
  }
  /// Regions are numbered after the records.
  [[nodiscard]] std::uint64_t key_of(ObjectIndex object, RegionId region) const noexcept {
    return key(object, RecordId{objects_[object]->summary->records + index(region)});
  }
  [[nodiscard]] static std::uint32_t blocks_for(std::uint64_t bits) noexcept {
    return static_cast<std::uint32_t>((bits + 8 * kPayload - 1) / (8 * kPayload));
  }
  [[nodiscard]] std::uint32_t write(const Bytes& bytes) noexcept;
  void free(std::uint32_t first) noexcept;
  /// Into `buffer_`.
  void read(std::uint32_t first);
  /// Into `list_`.
  void read_list(ObjectIndex object, RegionId region);
  [[nodiscard]] std::uint32_t length(std::uint32_t first) const noexcept;
  /// Calls `visit` with the key and the first block of each record of `list_`.
  template <class Visit>
  void for_each_listed(ObjectIndex object, Visit visit) const;

  std::vector<Block> blocks_;
  std::vector<std::uint16_t> holders_;  // by first block of a record: number of regions that list it
  std::vector<std::uint16_t> staying_;  // number of these that stay
  FlatIndex index_;                     // record or region -> first block
  std::uint32_t first_free_ = kNone, free_, leaving_ = 0;
  IdVector<ObjectIndex, std::optional<Object>> objects_;
  std::vector<std::uint8_t> buffer_;
  std::vector<Interval> list_;
  RegionData data_;
};

}  // namespace tactus::spm::codec
