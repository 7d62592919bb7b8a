#include "spm/cache.hpp"

#include <algorithm>
#include <numeric>

#include "spm/checksum.hpp"
#include "spm/record_decoder.hpp"

namespace tactus::spm {
namespace {

constexpr std::uint16_t kBaseSlot = 0xffff;  // in list_counts_: the slot belongs to a base mesh
constexpr std::uint16_t kMaxLists = 0x7fff;  // max number of lists with a record; SlotState cannot count more

bool in_intervals(std::span<const Interval> intervals, std::uint32_t id, std::size_t& hint) noexcept {
  while (hint < intervals.size() && id >= intervals[hint].first + intervals[hint].count) ++hint;
  return hint < intervals.size() && id >= intervals[hint].first;
}

std::uint64_t total(std::span<const Interval> intervals) noexcept {
  std::uint64_t count = 0;
  for (const Interval& interval : intervals) count += interval.count;
  return count;
}

/// True if the intervals ascend, are not empty, are below `limit`, and at least one id is between two of them.
bool well_formed(std::span<const Interval> intervals, std::uint32_t limit) noexcept {
  std::uint64_t next = 0;
  bool first = true;
  for (const Interval& interval : intervals) {
    if (interval.count == 0 || (!first && interval.first <= next) || (first && interval.first < next)) return false;
    next = std::uint64_t{interval.first} + interval.count;
    if (next > limit) return false;
    first = false;
  }
  return true;
}

}  // namespace

Cache::Cache(Pool& pool)
    : pool_{pool},
      slots_{pool.settings.slots, pool.settings.slots},
      rows_{2 * pool.settings.slots, 2 * pool.settings.slots},
      lists_{pool.settings.list_blocks, pool.settings.list_blocks},
      front_{2 * std::size_t{pool.settings.slots}},
      list_counts_(pool.settings.slots),
      checksums_(pool.settings.slots),
      object_of_(pool.settings.slots),
      listed_in_(pool.settings.slots),
      loaded_(pool.settings.list_blocks),
      free_{pool.settings.slots},
      free_blocks_(pool.settings.list_blocks),
      free_block_count_{pool.settings.list_blocks} {
  TACTUS_CHECK(pool.settings.slots <= kMaxSlots);
  for (std::uint32_t i = 0; i < free_block_count_; ++i) free_blocks_[i] = BlockIndex{free_block_count_ - 1 - i};
}

Cache::Admitted Cache::admit(const BaseMesh& base) {
  const auto vertices = static_cast<std::uint32_t>(base.positions.size());
  const auto faces = static_cast<std::uint32_t>(base.faces.size());
  const std::uint32_t needed = slots_for_base(base.summary);
  if (needed > free_.count()) return {};
  std::uint32_t number = next_object_;
  for (std::uint32_t tried = 0; number < objects_.size() && objects_[ObjectIndex{number}].is_used; ++tried) {
    if (tried == kMaxObjects) return {};
    number = (number + 1) % kMaxObjects;
  }
  next_object_ = (number + 1) % kMaxObjects;
  if (number >= objects_.size()) objects_.values().resize(number + 1);

  Admitted result;
  result.fits = true;
  result.object = ObjectIndex{number};
  Object& object = objects_[result.object];
  object = {};
  object.is_used = true;
  object.summary = base.summary;
  object.base_faces = faces;
  std::vector<Slot> slots(needed);
  for (Slot& slot : slots) {
    slot = allocate_slot();
    list_counts_[slot] = kBaseSlot;
    object_of_[slot] = static_cast<std::uint8_t>(number);
    pool_.parts[slot] = LoadedPart{};
    pool_.parts[slot].next = kNone;
    pool_.state[slot] = SlotState{};
  }
  for (std::uint32_t i = 0; i < vertices; ++i) {
    pool_.vertices[slots[i]] = {base.positions[i], VertexId{i}};
  }
  object.base_slots.values() = slots;

  result.base.faces.reserve(faces);
  std::vector<RowIndex> rows;
  rows.reserve(faces);
  for (std::uint32_t i = 0; i < faces; ++i) {
    const BaseFace& face = base.faces[i];
    BaseSlots::Face loaded{.row = row_of(slots[i / 2], i % 2)};
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const VertexId vertex = face.corners[corner];
      loaded.corners[corner] = object.base_slots[vertex];
      loaded.radius = std::max(loaded.radius, base.radii[index(vertex)]);
    }
    front_.set(loaded.row, loaded.corners);
    pool_.parts[slots[i / 2]].born[i % 2] = BornRef::make(face.face, 0, face.finest != 0);
    pool_.shown_at[loaded.row] = LeafLane{};
    rows_.insert(key(result.object, face.face), index(loaded.row));
    rows.push_back(loaded.row);
    result.base.faces.push_back(loaded);
  }
  front_.link(std::span<const RowIndex>{rows});
  return result;
}

void Cache::remove(ObjectIndex number) noexcept {
  Object& object = objects_[number];
  TACTUS_CHECK(object.is_used);
  TACTUS_CHECK(object.loaded_regions == 0);
  const std::vector<Slot>& slots = object.base_slots.values();
  for (std::uint32_t i = 0; i < object.base_faces; ++i) {
    const RowIndex row = row_of(slots[i / 2], i % 2);
    rows_.erase(key(number, pool_.face_of(row)), index(row), key_of_row());
  }
  for (const Slot slot : slots) {
    list_counts_[slot] = 0;
    free_.release(index(slot));
  }
  object = {};
}

/// The Store of RecordDecoder for an object of the cache.
struct Cache::DecoderStore {
  using Vertex = Slot;
  using Face = RowIndex;
  using Part = Slot;
  Cache& cache;
  ObjectIndex object;

  [[nodiscard]] Front& front() const noexcept { return cache.front_; }
  [[nodiscard]] Slot vertex(VertexId id) const noexcept {
    const Object& owner = cache.objects_[object];
    const std::uint32_t base = owner.summary.base_vertices;
    return index(id) < base ? owner.base_slots[id] : cache.find(object, RecordId{index(id) - base});
  }
  [[nodiscard]] RowIndex face(FaceId id) const noexcept { return cache.find(object, id); }
  [[nodiscard]] RowIndex add_born_face(FaceId id, Slot slot, std::uint32_t i) const noexcept {
    const RowIndex row = row_of(slot, i);
    cache.rows_.insert(key(object, id), index(row));
    cache.pool_.shown_at[row] = LeafLane{};
    return row;
  }
  [[nodiscard]] const std::array<float, 3>& position(Slot slot) const noexcept {
    return cache.pool_.vertices[slot].position;
  }
};

AcceptResult Cache::decode(ObjectIndex object, RecordId record, const RegionData& data, std::uint32_t& part,
                           const PositionPredictor::Residuals& residuals) noexcept {
  const ModelSummary& summary = objects_[object].summary;
  const VertexId id = vertex_of(object, record);
  const Slot u = next_slot();  // the loop allocates it
  DecoderStore store{*this, object};
  RecordDecoder<DecoderStore> decoder{store, summary, u};
  std::array<float, 3> position{};
  Slot slot = kNone;
  for (bool more = true; more;) {
    if (part >= data.parts.size()) return AcceptResult::kMalformed;
    const RecordPart& source = data.parts[part];
    if (free_.count() == 0) return AcceptResult::kPoolFull;
    const Slot before = slot;
    slot = allocate_slot();
    if (before != kNone) pool_.parts[before].next = slot;
    pool_.state[slot] = SlotState{};
    pool_.vertices[slot] = {position, id};
    object_of_[slot] = static_cast<std::uint8_t>(index(object));
    if (before == kNone) slots_.insert(key(object, id), index(slot));
    list_counts_[slot] = 0;
    switch (decoder.add(source, slot, pool_.parts[slot])) {
      case RecordResult::kDecoded:
        break;
      case RecordResult::kIncomplete:
        return AcceptResult::kIncomplete;
      case RecordResult::kMalformed:
        return AcceptResult::kMalformed;
    }
    if (before == kNone) {
      if (!decoder.restore_position(residuals, position)) return AcceptResult::kMalformed;
      pool_.vertices[slot].position = position;
    }
    more = source.next != kNone;
    if (more && source.next != PartIndex{part + 1}) return AcceptResult::kMalformed;
    ++part;
  }
  decoder.finish();
  checksums_[u] = checksum_of(id, decoder.ring(), [this](Slot at) { return pool_.vertices[at].id; });
  return AcceptResult::kAccepted;
}

bool Cache::add_to_list(Slot first_slot) noexcept {
  const auto is_listed = [this](Slot slot) {
    return list_counts_[slot] == kBaseSlot || listed_in_[slot] == list_number_;
  };
  for (Slot slot = first_slot; slot != kNone; slot = pool_.parts[slot].next) {
    const LoadedPart& part = pool_.parts[slot];
    if (!is_listed(part.parent)) return false;
    for (std::uint32_t i = 0; i < part.born_count; ++i)
      if (!is_listed(part.born_x[i])) return false;
    for (std::uint32_t i = 0; i < part.deformed_count; ++i)
      if (!is_listed(slot_of(part.deformed(i).face()))) return false;
  }
  for (Slot slot = first_slot; slot != kNone; slot = pool_.parts[slot].next) listed_in_[slot] = list_number_;
  return true;
}

void Cache::free_record(ObjectIndex object, Slot first_slot) noexcept {
  slots_.erase(key(object, pool_.vertices[first_slot].id), index(first_slot), key_of_slot());
  for (Slot slot = first_slot; slot != kNone;) {
    const LoadedPart& part = pool_.parts[slot];
    TACTUS_CHECK(pool_.state[slot].bits == 0);
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
      const LoadedPart::DeformedRef ref = part.deformed(i);
      const Front::CornerRef corner{ref.face(), ref.corner()};
      TACTUS_CHECK(front_.corners(corner.face)[corner.corner] == first_slot);
      front_.set_corner(corner, part.parent);
    }
    for (std::uint32_t i = 0; i < part.born_count; ++i) {
      const RowIndex row = row_of(slot, i);
      front_.unlink(row, part.born[i].order());
      rows_.erase(key(object, part.born[i].face()), index(row), key_of_row());
    }
    const Slot next = part.next;
    free_.release(index(slot));
    slot = next;
  }
}

AcceptResult Cache::accept(ObjectIndex number, const RegionData& data, const ListSummary& expected,
                           RegionList& out) noexcept {
  Object& object = objects_[number];
  if (index(data.region) >= object.summary.regions) return AcceptResult::kMalformed;
  if (is_loaded(number, data.region)) return AcceptResult::kLoaded;
  const std::span<const Interval> list{data.list};
  const std::span<const Interval> sent{data.sent};
  if (!well_formed(list, object.summary.records) || !well_formed(sent, object.summary.records) ||
      total(list) != expected.records || total(sent) != data.residuals.size())
    return AcceptResult::kMalformed;
  const auto length = static_cast<std::uint32_t>(total(list));
  if (ListBlock::blocks_for(length) > free_block_count_) return AcceptResult::kPoolFull;

  if (++list_number_ == 0) {
    std::fill(listed_in_.begin(), listed_in_.end(), std::uint8_t{0});
    list_number_ = 1;
  }
  RegionList new_list;
  BlockIndex block = kNone;
  const auto append = [&](Slot slot) noexcept {
    const std::uint32_t place = new_list.length % ListBlock::kEntries;
    if (place == 0) {
      const BlockIndex before = block;
      block = free_blocks_[--free_block_count_];
      pool_.blocks[block].before = before;
      pool_.blocks[block].after = kNone;
      if (before == kNone)
        new_list.first_block = block;
      else
        pool_.blocks[before].after = block;
    }
    if (slot == kNone) return;
    pool_.blocks[block].slots[place] = slot;
    ++new_list.length;
  };
  if (length == 0) append(kNone);

  AcceptResult result = AcceptResult::kAccepted;
  std::size_t hint = 0;
  std::uint32_t part = 0;
  std::uint32_t position = 0;
  std::uint32_t checksum = 0;
  std::uint64_t repeated = 0, accepted = 0;
  for (const Interval& interval : list) {
    for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) {
      const RecordId record{r};
      const bool is_sent = in_intervals(sent, r, hint);
      Slot slot = find(number, record);
      if (slot != kNone && is_sent) {  // the record is already loaded: skips its parts
        ++repeated;
        while (part < data.parts.size() && data.parts[part].next != kNone) ++part;
        ++part;
        ++position;
      } else if (slot == kNone && !is_sent) {
        result = AcceptResult::kIncomplete;
      } else if (slot == kNone) {
        result = free_.count() == 0 ? AcceptResult::kPoolFull : AcceptResult::kAccepted;
        if (result == AcceptResult::kAccepted) {
          slot = next_slot();
          result = decode(number, record, data, part, data.residuals[position++]);
          if (result != AcceptResult::kAccepted && find(number, record) != kNone) free_record(number, slot);
          ++accepted;
        }
      }
      if (result == AcceptResult::kAccepted && !add_to_list(slot)) {
        result = AcceptResult::kMalformed;
        if (list_counts_[slot] == 0) free_record(number, slot);
      }
      if (result == AcceptResult::kAccepted && list_counts_[slot] == kMaxLists) result = AcceptResult::kPoolFull;
      if (result != AcceptResult::kAccepted) break;
      ++list_counts_[slot];
      checksum += checksums_[slot];
      append(slot);
    }
    if (result != AcceptResult::kAccepted) break;
  }
  if (result == AcceptResult::kAccepted &&
      (part != data.parts.size() || position != data.residuals.size() || checksum != expected.checksum))
    result = AcceptResult::kMalformed;
  if (result != AcceptResult::kAccepted) {
    if (new_list.first_block != kNone) release_list(number, new_list);
    return result;
  }
  counters_.records_accepted += accepted;
  counters_.records_repeated += repeated;
  loaded_[new_list.first_block] = {data.region, new_list.length, number};
  lists_.insert(key(number, data.region), index(new_list.first_block));
  ++object.loaded_regions;
  out = new_list;
  return AcceptResult::kAccepted;
}

void Cache::release_list(ObjectIndex number, const RegionList& list) noexcept {
  // Walks backwards, so that a record is freed before the records that it needs.
  BlockIndex block = list.first_block;
  while (pool_.blocks[block].after != kNone) block = pool_.blocks[block].after;
  std::uint32_t left = list.length;
  while (block != kNone) {
    const std::uint32_t in_block = left == 0 ? 0 : (left - 1) % ListBlock::kEntries + 1;
    for (std::uint32_t i = in_block; i-- > 0;) {
      const Slot slot = pool_.blocks[block].slots[i];
      if (--list_counts_[slot] == 0) free_record(number, slot);
    }
    left -= in_block;
    const BlockIndex before = pool_.blocks[block].before;
    free_blocks_[free_block_count_++] = block;
    block = before;
  }
}

/// Unloads the region whose list begins in the block.
void Cache::release_region(BlockIndex first_block) noexcept {
  LoadedRegion& loaded = loaded_[first_block];
  lists_.erase(key(loaded.object, loaded.region), index(first_block), key_of_list());
  release_list(loaded.object, {first_block, loaded.length});
  --objects_[loaded.object].loaded_regions;
  loaded = {};
  ++counters_.regions_released;
}

void Cache::release(ObjectIndex object, RegionId region) noexcept {
  const BlockIndex first_block = find(object, region);
  TACTUS_CHECK(first_block != kNone);
  release_region(first_block);
}

void Cache::release_all(ObjectIndex object) noexcept {
  for (LoadedAt at; (at = next_loaded(object, at.block)).region != kNone;) release_region(at.block);
}

Cache::LoadedAt Cache::next_loaded(ObjectIndex object, BlockIndex from) const noexcept {
  for (std::uint32_t block = index(from); block < loaded_.size(); ++block) {
    const LoadedRegion& loaded = loaded_[BlockIndex{block}];
    if (loaded.region != kNone && loaded.object == object) return {loaded.region, BlockIndex{block}};
  }
  return {};
}

std::vector<std::string> Cache::violations() const {
  std::vector<std::string> found;
  IdVector<Slot, std::uint32_t> counts(list_counts_.size());
  std::uint32_t used_blocks = 0;
  IdVector<ObjectIndex, std::uint32_t> loaded_regions(objects_.size());
  for (const BlockIndex first_block : loaded_.ids()) {
    const LoadedRegion& loaded = loaded_[first_block];
    if (loaded.region == kNone) continue;
    ++loaded_regions[loaded.object];
    if (find(loaded.object, loaded.region) != first_block)
      found.push_back("region " + std::to_string(index(loaded.region)) + " is loaded, but not in the index");
    std::uint32_t left = loaded.length;
    for (BlockIndex block = first_block; block != kNone; block = pool_.blocks[block].after) {
      ++used_blocks;
      for (std::uint32_t i = 0; i < ListBlock::kEntries && left > 0; ++i, --left)
        ++counts[pool_.blocks[block].slots[i]];
    }
    if (left != 0) found.push_back("the list of a region has " + std::to_string(left) + " entries too few");
  }
  for (const ObjectIndex object : objects_.ids())
    if (loaded_regions[object] != objects_[object].loaded_regions)
      found.push_back("object " + std::to_string(index(object)) + " has " + std::to_string(loaded_regions[object]) +
                      " loaded regions, but its count is " + std::to_string(objects_[object].loaded_regions));
  if (used_blocks + free_block_count_ != pool_.settings.list_blocks)
    found.push_back(std::to_string(used_blocks) + " blocks in use and " + std::to_string(free_block_count_) +
                    " free of " + std::to_string(pool_.settings.list_blocks));
  std::uint32_t used_slots = 0;
  for (const Slot slot : list_counts_.ids()) {
    if (list_counts_[slot] == kBaseSlot) {
      ++used_slots;
      continue;
    }
    if (counts[slot] > 0 && free_.is_free(index(slot)))
      found.push_back("slot " + std::to_string(index(slot)) + " is listed and free");
    if (counts[slot] > 0 && counts[slot] != list_counts_[slot])
      found.push_back("slot " + std::to_string(index(slot)) + " is in " + std::to_string(counts[slot]) +
                      " lists, but its count is " + std::to_string(list_counts_[slot]));
    if (counts[slot] > 0)
      for (Slot part = slot; part != kNone; part = pool_.parts[part].next) ++used_slots;
  }
  if (used_slots + free_.count() != pool_.settings.slots)
    found.push_back(std::to_string(used_slots) + " slots in use and " + std::to_string(free_.count()) + " free of " +
                    std::to_string(pool_.settings.slots));
  return found;
}

}  // namespace tactus::spm
