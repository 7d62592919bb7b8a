#include "spm/codec/compressed_cache.hpp"

#include <algorithm>
#include <cstring>

#include "spm/codec/interval_codec.hpp"
#include "spm/codec/record_reader.hpp"
#include "spm/codec/region_codec.hpp"
#include "spm/directory.hpp"

namespace tactus::spm::codec {
namespace {

constexpr std::uint16_t kMaxLists = 0xffff;
static_assert(ReceivedRecords::kMaxBytes == kReceivedRecordsBytes);

}  // namespace

CompressedCache::CompressedCache(std::uint32_t blocks)
    : blocks_(blocks),
      lists_with_(blocks, 0),
      unretired_lists_with_(blocks, 0),
      loaded_lists_with_(blocks, 0),
      index_{blocks},
      first_free_{blocks == 0 ? kNone : 0u},
      free_blocks_{blocks} {
  for (std::uint32_t i = 0; i < blocks; ++i) blocks_[i].next = i + 1 < blocks ? i + 1 : kNone;
}

void CompressedCache::admit(ObjectIndex object, const ModelSummary& summary, const RecordTables& tables) {
  if (index(object) >= objects_.size()) objects_.values().resize(index(object) + 1);
  objects_[object].emplace(Object{&summary, &tables, {}});
}

std::uint32_t CompressedCache::write_chain(const Bytes& bytes) noexcept {
  const std::uint32_t first = first_free_;
  std::uint32_t last = kNone;
  for (std::size_t at = 0; at < bytes.size(); at += kPayloadBytes) {
    last = first_free_;
    TACTUS_CHECK(last != kNone);
    Block& block = blocks_[last];
    first_free_ = block.next;
    --free_blocks_;
    block.bytes = {};
    std::memcpy(block.bytes.data(), &bytes[at], std::min(kPayloadBytes, bytes.size() - at));
  }
  blocks_[last].next = kNone;
  return first;
}

void CompressedCache::free_chain(std::uint32_t first) noexcept {
  std::uint32_t last = first;
  for (++free_blocks_; blocks_[last].next != kNone; last = blocks_[last].next) ++free_blocks_;
  blocks_[last].next = first_free_;
  first_free_ = first;
}

void CompressedCache::read_chain(std::uint32_t first) {
  buffer_.clear();
  for (std::uint32_t at = first; at != kNone; at = blocks_[at].next)
    buffer_.insert(buffer_.end(), blocks_[at].bytes.begin(), blocks_[at].bytes.end());
}

void CompressedCache::read_list(ObjectIndex object, RegionId region) {
  const Object& of = *objects_[object];
  read_chain(index_.find(key_of(object, region)));
  BitReader in{buffer_};
  std::uint32_t total = 0;
  const std::string error = get_intervals(in, *of.tables, of.summary->records, list_, total);
  TACTUS_CHECK(error.empty());
}

CompressedCache::PutResult CompressedCache::put(ObjectIndex number, RegionId region,
                                                std::span<const std::uint8_t> message) {
  using Status = PutResult::Status;
  Object& object = *objects_[number];
  PutResult put;
  if (index(region) < object.summary->regions && holds(number, region)) {
    put.status = Status::kAlreadyHeld;
    return put;
  }
  // Every listed record takes a block, whether it is sent or in the cache.
  const Result<RegionCodes> checked = check_region(message, *object.summary, *object.tables, blocks());
  if (!checked || checked->region != region) {
    put.error = checked ? "contains region " + std::to_string(index(checked->region)) : checked.error().text;
    return put;
  }
  const RegionCodes& data = *checked;
  if (data.is_too_long) {
    put.status = Status::kFull;
    put.blocks = put.blocks_if_empty = blocks() + 1;
    return put;
  }
  const std::vector<RecordCode>& codes = data.codes;
  put.records = static_cast<std::uint32_t>(codes.size());

  BitWriter list;
  put_intervals(list, *object.tables, data.list);
  put.blocks = put.blocks_if_empty = blocks_for(list.size());
  std::size_t code = 0;
  const Interval* sent = data.sent.data();
  const Interval* const sent_end = sent + data.sent.size();
  // Calls `visit` with each record of the list, its first block or kNone, and its code in the message or null. Stops
  // if `visit` returns false.
  const auto for_each = [&](const auto& visit) {
    code = 0;
    sent = data.sent.data();
    for (const Interval& interval : data.list)
      for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) {
        while (sent != sent_end && sent->first + sent->count <= r) ++sent;
        const bool is_sent = sent != sent_end && sent->first <= r;
        const RecordId record{r};
        if (!visit(record, index_.find(key(number, record)), is_sent ? &codes[code] : nullptr)) return false;
        code += is_sent ? 1 : 0;
      }
    return true;
  };
  put.status = Status::kStored;
  const bool complete = for_each([&](RecordId, std::uint32_t block, const RecordCode* received) {
    if (received != nullptr) {
      const std::uint32_t needed = blocks_for(kAnchorBits + received->bits);
      put.blocks_if_empty += needed;
      if (block == kNone) put.blocks += needed;
    }
    if (block != kNone && lists_with_[block] == kMaxLists) put.status = Status::kFull;
    return block != kNone || received != nullptr;
  });
  if (!complete) put.status = Status::kIncomplete;
  if (complete && put.blocks > free_blocks_) put.status = Status::kFull;
  if (put.status != Status::kStored) return put;

  index_.insert(key_of(number, region), write_chain(list.take()));
  static_cast<void>(for_each([&](RecordId record, std::uint32_t block, const RecordCode* received) {
    if (received != nullptr) put.returned += object.received.add(record);
    if (received != nullptr && block != kNone) ++put.repeated;
    if (received != nullptr && block != kNone && unretired_lists_with_[block] > 0) ++put.repeated_unretired;
    if (block == kNone) {
      BitWriter out;
      out.put(index(received->anchor), kAnchorBits);
      out.copy(message, received->first, received->bits);
      block = write_chain(out.take());
      lists_with_[block] = unretired_lists_with_[block] = loaded_lists_with_[block] = 0;
      index_.insert(key(number, record), block);
    }
    if (unretired_lists_with_[block]++ == 0 && lists_with_[block] > 0) retired_blocks_ -= chain_length(block);
    ++lists_with_[block];
    return true;
  }));
  return put;
}

const RegionData* CompressedCache::get(ObjectIndex number, RegionId region) {
  RecordReader reader{*objects_[number]->summary, *objects_[number]->tables};
  read_list(number, region);
  data_.region = region;
  data_.list = list_;
  data_.sent.clear();
  data_.residuals.clear();
  data_.parts.clear();
  for (const Interval& interval : data_.list)
    for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) {
      const RecordId record{r};
      const std::uint32_t block = index_.find(key(number, record));
      if (loaded_lists_with_[block] > 0) continue;
      read_chain(block);
      BitReader in{buffer_};
      const FaceId anchor{static_cast<std::uint32_t>(in.get(kAnchorBits))};
      data_.residuals.emplace_back();
      if (!reader.get(in, record, anchor, data_.parts, data_.residuals.back())) return nullptr;
      if (!data_.sent.empty() && data_.sent.back().first + data_.sent.back().count == r) {
        ++data_.sent.back().count;
      } else {
        data_.sent.push_back({r, 1});
      }
    }
  return &data_;
}

std::uint32_t CompressedCache::chain_length(std::uint32_t first) const noexcept {
  std::uint32_t length = 0;
  for (std::uint32_t at = first; at != kNone; at = blocks_[at].next) ++length;
  return length;
}

template <class Visit>
void CompressedCache::for_each_listed(ObjectIndex object, Visit visit) const {
  for (const Interval& interval : list_)
    for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) {
      const std::uint64_t key_of_record = key(object, RecordId{r});
      visit(key_of_record, index_.find(key_of_record));
    }
}

void CompressedCache::mark_loaded(ObjectIndex object, RegionId region) noexcept {
  read_list(object, region);
  for_each_listed(object, [&](std::uint64_t, std::uint32_t block) { ++loaded_lists_with_[block]; });
}

void CompressedCache::mark_unloaded(ObjectIndex object, RegionId region) noexcept {
  read_list(object, region);
  for_each_listed(object, [&](std::uint64_t, std::uint32_t block) { --loaded_lists_with_[block]; });
}

void CompressedCache::retire(ObjectIndex object, RegionId region) noexcept {
  read_list(object, region);
  for_each_listed(object, [&](std::uint64_t, std::uint32_t block) {
    if (--unretired_lists_with_[block] == 0) retired_blocks_ += chain_length(block);
  });
  retired_blocks_ += chain_length(index_.find(key_of(object, region)));
}

void CompressedCache::reinstate(ObjectIndex object, RegionId region) noexcept {
  read_list(object, region);
  for_each_listed(object, [&](std::uint64_t, std::uint32_t block) {
    if (unretired_lists_with_[block]++ == 0) retired_blocks_ -= chain_length(block);
  });
  retired_blocks_ -= chain_length(index_.find(key_of(object, region)));
}

void CompressedCache::evict(ObjectIndex object, RegionId region) noexcept {
  const std::uint32_t free_before = free_blocks_;
  read_list(object, region);
  for_each_listed(object, [&](std::uint64_t key_of_record, std::uint32_t block) {
    if (--lists_with_[block] > 0) return;
    index_.erase(key_of_record);
    free_chain(block);
  });
  const std::uint64_t key = key_of(object, region);
  free_chain(index_.find(key));
  index_.erase(key);
  retired_blocks_ -= free_blocks_ - free_before;
}

std::vector<std::string> CompressedCache::violations() {
  std::vector<std::string> found;
  std::vector<std::uint32_t> counted(blocks_.size(), 0);  // regions that list the record, by its first block
  std::vector<bool> taken(blocks_.size(), false);
  std::uint32_t chained = 0;
  const auto take_chain = [&](std::uint32_t first, const std::string& what) {
    for (std::uint32_t at = first; at != kNone; at = blocks_[at].next) {
      if (taken[at]) found.push_back(what + ": block " + std::to_string(at) + " also belongs to another chain");
      if (taken[at]) return;
      taken[at] = true;
      ++chained;
    }
  };
  for (const ObjectIndex number : objects_.ids()) {
    if (!objects_[number]) continue;
    for (const RegionId region : ids<RegionId>(objects_[number]->summary->regions)) {
      const std::uint32_t first = index_.find(key_of(number, region));
      if (first == kNone) continue;
      take_chain(first, "region " + std::to_string(index(region)));
      read_list(number, region);
      for (const Interval& interval : list_)
        for (std::uint32_t record = interval.first; record != interval.first + interval.count; ++record) {
          const std::uint32_t block = index_.find(key(number, RecordId{record}));
          if (block == kNone)
            found.push_back("record " + std::to_string(record) + " of region " + std::to_string(index(region)) +
                            " is not in the cache");
          else if (counted[block]++ == 0)
            take_chain(block, "record " + std::to_string(record));
        }
    }
  }
  for (std::uint32_t block = 0; block < blocks_.size(); ++block)
    if (counted[block] > 0 &&
        (counted[block] != lists_with_[block] || unretired_lists_with_[block] > lists_with_[block] ||
         loaded_lists_with_[block] > lists_with_[block]))
      found.push_back("block " + std::to_string(block) + ": found its record in " + std::to_string(counted[block]) +
                      " lists, counted " + std::to_string(lists_with_[block]));
  if (chained + free_blocks_ != blocks_.size())
    found.push_back(std::to_string(chained) + " blocks in use and " + std::to_string(free_blocks_) + " free of " +
                    std::to_string(blocks_.size()));
  return found;
}

}  // namespace tactus::spm::codec
