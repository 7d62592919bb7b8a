/// Regions as they came: lists and records' codes, in memory of a fixed size.
///
/// A record takes some 38 bytes here and ten times that in a pool, so a controller keeps more than it could show: what
/// a tip may meet within a round trip of the network is here, what it meets in the next moments is decoded into the
/// pool as well. A host is told that a controller has what is here.
///
///     put      message -> blocks       counts for each record how many regions here list it
///     get      blocks -> RegionData    with those of the records that the pool lacks
///     release  frees the list and what only this region needed
///
/// All in blocks that are linked to chains, one chain for a record and one for a list. One thread. Does not allocate
/// after `admit`, but for what it decodes with.
#pragma once

#include <cstdint>
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

  /// Objects are numbered in this order, as by Cache. Both must outlive the store. Allocates a bit a record.
  void admit(const ModelSummary& summary, const RecordTables& tables);

  struct Put {
    enum class Status : std::uint8_t {
      kKept,
      kHere,        ///< it is here already
      kFull,        ///< `blocks` are needed: release something and ask again
      kIncomplete,  ///< a record of its list is neither here nor in the message
      kMalformed    ///< `error` says why
    };
    Status status = Status::kMalformed;
    std::uint32_t records = 0;    ///< in the message
    std::uint32_t returned = 0;   ///< of these, which are here or were once
    std::uint32_t repeated = 0;   ///< of these, which are here
    std::uint32_t published = 0;  ///< of these, listed by regions that do not leave, so published to hosts
    std::uint32_t blocks = 0;     ///< taken, or needed
    std::uint32_t whole = 0;      ///< blocks that list and records of the message take where none of them is
    std::string error;
  };
  /// Takes a message of this region. Anything but kKept leaves the store as it was. O(list + message); what it
  /// decodes to see that the message is one is not kept.
  [[nodiscard]] Put put(ObjectIndex object, RegionId region, Span<const std::uint8_t> message);

  [[nodiscard]] bool keeps(ObjectIndex object, RegionId region) const noexcept {
    return index_.find(key_of(object, region)) != kNone;
  }
  /// The region's list, and those of its records for which `cache` has no slot; the region must be here.
  [[nodiscard]] const RegionData& get(ObjectIndex object, RegionId region, const Cache& cache);

  /// A region that leaves is as here as before, but what only regions that leave need counts as leaving. O(list).
  void leave(ObjectIndex object, RegionId region) noexcept;
  /// It does not leave after all. O(list).
  void stay(ObjectIndex object, RegionId region) noexcept;
  /// Frees what only this region needed; it must have left. O(list).
  void release(ObjectIndex object, RegionId region) noexcept;

  [[nodiscard]] std::uint32_t blocks() const noexcept { return static_cast<std::uint32_t>(blocks_.size()); }
  [[nodiscard]] std::uint32_t blocks_free() const noexcept { return free_; }
  /// That will be free once all regions that leave are released.
  [[nodiscard]] std::uint32_t blocks_leaving() const noexcept { return leaving_; }

  /// What is broken, in words. O(blocks), allocates: tests.
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
    std::vector<bool> seen;  // by record: has been here before
  };

  [[nodiscard]] static std::uint64_t key(ObjectIndex object, std::uint32_t id) noexcept {
    return std::uint64_t{index(object)} << 31 | id;
  }
  /// Regions are numbered after the records.
  [[nodiscard]] std::uint64_t key_of(ObjectIndex object, RegionId region) const noexcept {
    return key(object, objects_[index(object)].summary->records + index(region));
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
  /// Calls with the first block of each record of `list_`.
  template <class Visit>
  void for_each_listed(ObjectIndex object, Visit visit) const;

  std::vector<Block> blocks_;
  std::vector<std::uint16_t> holders_;  // by first block of a record: regions that list it,
  std::vector<std::uint16_t> staying_;  // and of these, those that do not leave
  FlatIndex index_;                     // record or region -> first block
  std::uint32_t first_free_ = kNone, free_, leaving_ = 0;
  std::vector<Object> objects_;
  std::vector<std::uint8_t> buffer_;
  std::vector<Interval> list_;
  RegionData data_;
};

}  // namespace tactus::spm::codec
