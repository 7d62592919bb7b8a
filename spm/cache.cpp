#include "spm/cache.hpp"

#include <algorithm>
#include <numeric>

#include "spm/checksum.hpp"
#include "spm/position_predictor.hpp"

namespace tactus::spm {
namespace {

constexpr std::uint16_t kPinned = 0xffff;
constexpr std::uint16_t kMaxLists = 0x7fff;  // that count a record: so many a forest can count, see SlotState

bool in_runs(Span<const Interval> intervals, std::uint32_t id, std::size_t& hint) noexcept {
  while (hint < intervals.size() && id >= intervals[hint].first + intervals[hint].count) ++hint;
  return hint < intervals.size() && id >= intervals[hint].first;
}

std::uint64_t total(Span<const Interval> intervals) noexcept {
  std::uint64_t count = 0;
  for (const Interval& run : intervals) count += run.count;
  return count;
}

/// Ascending, in range, not empty, not touching.
bool well_formed(Span<const Interval> intervals, std::uint32_t limit) noexcept {
  std::uint64_t next = 0;
  bool first = true;
  for (const Interval& run : intervals) {
    if (run.count == 0 || (!first && run.first <= next) || (first && run.first < next)) return false;
    next = std::uint64_t{run.first} + run.count;
    if (next > limit) return false;
    first = false;
  }
  return true;
}

}  // namespace

Cache::Cache(Pool& pool)
    : pool_{pool},
      records_{pool.settings.slots},
      faces_{2 * pool.settings.slots},
      front_{2 * std::size_t{pool.settings.slots}},
      loaded_(pool.settings.slots, 0),
      checksums_(pool.settings.slots, 0),
      free_{pool.settings.slots},
      free_blocks_(pool.settings.list_blocks),
      free_block_count_{pool.settings.list_blocks} {
  for (std::uint32_t i = 0; i < free_block_count_; ++i) free_blocks_[i] = free_block_count_ - 1 - i;
}

std::uint32_t Cache::slots_for_base(const BaseMesh& base) noexcept {
  return static_cast<std::uint32_t>(std::max(base.positions.size(), (base.faces.size() + 1) / 2));
}

Cache::Admitted Cache::admit(const BaseMesh& base) {
  const auto vertices = static_cast<std::uint32_t>(base.positions.size());
  const auto faces = static_cast<std::uint32_t>(base.faces.size());
  const std::uint32_t needed = slots_for_base(base);
  if (needed > free_.count()) return {};

  Admitted result;
  result.fits = true;
  result.object = ObjectIndex{static_cast<std::uint32_t>(objects_.size())};
  Object object;
  object.summary = base.summary;
  std::vector<std::uint32_t> slots(needed);
  for (std::uint32_t& slot : slots) {
    slot = take_slot();
    loaded_[slot] = kPinned;
    pool_.parts[slot] = RecordPart{};
    pool_.parts[slot].next = kNone;
    pool_.state[slot] = SlotState{};
  }
  for (std::uint32_t i = 0; i < vertices; ++i) {
    pool_.vertices[slots[i]] = {base.positions[i], i};
    pool_.radius[slots[i]] = radius_of(base.radii[i]);
  }
  object.base_slots.assign(slots.begin(), slots.begin() + vertices);

  result.base.faces.reserve(faces);
  for (std::uint32_t i = 0; i < faces; ++i) {
    const BaseFace& face = base.faces[i];
    const std::uint32_t row_index = 2 * slots[i / 2] + i % 2;
    FaceRow& row = pool_.faces[row_index];
    for (int corner = 0; corner < 3; ++corner) row.vertices[corner] = slots[face.corners[corner]];
    front_.set(row_index, row.vertices);
    row.face = face.face;
    row.last = face.last;
    row.node = kNone;
    faces_.insert(key(result.object, face.face), row_index);
    result.base.faces.push_back(row_index);
  }
  front_.link(result.base.faces);
  object.record_counts.reserve(base.regions.size());
  object.checksums.reserve(base.regions.size());
  for (const Region& region : base.regions) {
    object.record_counts.push_back(region.record_count);
    object.checksums.push_back(region.checksum);
  }
  object.first_blocks.resize(base.regions.size(), kNone);
  objects_.push_back(std::move(object));
  return result;
}

std::uint32_t Cache::slot_of_vertex(const Object& object, ObjectIndex number, std::uint32_t vertex) const noexcept {
  if (vertex < object.summary.base_vertices) return object.base_slots[vertex];
  return records_.find(key(number, vertex - object.summary.base_vertices));
}

/// Names the parent where it is implied, notes the vertices around it, and moves the corners from t to u.
AcceptResult Cache::enter_deformed(ObjectIndex number, const RecordPart& source, std::uint32_t u, RecordPart& target,
                                   Entered& entered) noexcept {
  for (int i = 0; i < source.deformed_count; ++i) {
    const DeformedRef ref = source.deformed[i];
    std::uint32_t row = kNone;
    std::uint32_t corner = ref.corner();
    if (ref.face() == kNextAround) {
      if (entered.last.face == kNone || !front_.swing(entered.last)) return AcceptResult::kMalformed;
      row = entered.last.face;
    } else {
      row = faces_.find(key(number, ref.face()));
      if (row == kNone) return AcceptResult::kIncomplete;
    }
    std::array<std::uint32_t, 3>& corners = front_.corners(row);
    if (target.parent == kNone) {
      if (corner == kCornerOfParent) return AcceptResult::kMalformed;
      target.parent = corners[corner];
      entered.ring.add(target.parent);
    } else {
      corner = 0;
      while (corner < 3 && corners[corner] != target.parent) ++corner;
    }
    if (corner > 2) return AcceptResult::kMalformed;
    const std::uint32_t next = corners[(corner + 1) % 3], before = corners[(corner + 2) % 3];
    if (target.parent == u || next == u || before == u) return AcceptResult::kMalformed;
    entered.ring.add(next);
    entered.ring.add(before);
    corners[corner] = u;
    entered.last = {row, corner};
    entered.faces.deform(entered.last);
    target.deformed[i] = DeformedRef::make(row, corner, ref.last());
    target.deformed_count = static_cast<std::uint8_t>(i + 1);
  }
  return AcceptResult::kAccepted;
}

AcceptResult Cache::enter_born(ObjectIndex number, const RecordPart& source, std::uint32_t u, std::uint32_t slot,
                               Entered& entered) noexcept {
  VertexRing& ring = entered.ring;
  const Object& object = objects_[index(number)];
  RecordPart& target = pool_.parts[slot];
  for (int i = 0; i < source.born_count; ++i) {
    if (source.born[i].face() >= object.summary.faces || source.born[i].order() > 5) return AcceptResult::kMalformed;
    std::uint32_t x = source.born_x[i];
    if ((x & kInRing) != 0) {
      x = x == (kInRing | kLastInRing) ? ring.size() - 1 : x & ~kInRing;
      if (x >= ring.size()) return AcceptResult::kMalformed;
      x = ring[x];
    } else {
      x = slot_of_vertex(object, number, x);
      if (x == kNone) return AcceptResult::kIncomplete;
      ring.add(x);
    }
    const std::uint64_t face_key = key(number, source.born[i].face());
    if (x == u || x == target.parent || faces_.find(face_key) != kNone) return AcceptResult::kMalformed;
    const std::uint32_t row = 2 * slot + static_cast<std::uint32_t>(i);
    faces_.insert(face_key, row);
    pool_.faces[row].face = source.born[i].face();
    pool_.faces[row].node = kNone;
    const BornCorners at = born_corners(source.born[i].order());
    LoadedFront::Corners corners{};
    corners[static_cast<std::size_t>(at.u)] = u;
    corners[static_cast<std::size_t>(at.t)] = target.parent;
    corners[static_cast<std::size_t>(at.x)] = x;
    front_.set(row, corners);
    entered.faces.bear(row, source.born[i].order());
    target.born_x[i] = x;
    target.born_count = static_cast<std::uint8_t>(i + 1);
  }
  return AcceptResult::kAccepted;
}

bool Cache::place(const Object& object, const VertexRing& ring, const std::array<std::uint32_t, 3>& offset,
                  std::array<float, 3>& position) const noexcept {
  const auto position_of = [this](std::uint32_t slot) -> const std::array<float, 3>& {
    return pool_.vertices[slot].position;
  };
  return PositionPredictor{object.summary, ring, position_of}.place(offset, position);
}

AcceptResult Cache::decode(ObjectIndex number, std::uint32_t record, const RegionData& data, std::uint32_t& part,
                           const std::array<std::uint32_t, 3>& offset) noexcept {
  const Object& object = objects_[index(number)];
  const std::uint32_t u = next_slot();  // taken below
  Entered entered;
  VertexRing& ring = entered.ring;
  std::array<float, 3> position{};
  std::uint32_t slot = kNone;
  std::uint32_t parent = kNone;
  for (bool more = true; more;) {
    if (part >= data.parts.size()) return AcceptResult::kMalformed;
    const RecordPart& source = data.parts[part];
    if (source.born_count > kBornPerPart || source.deformed_count > kDeformedPerPart) return AcceptResult::kMalformed;
    if (source.radius >= kRadiusCodes) return AcceptResult::kMalformed;
    if (free_.count() == 0) return AcceptResult::kPoolFull;

    const std::uint32_t before = slot;
    slot = take_slot();
    if (before != kNone) pool_.parts[before].next = slot;
    RecordPart& target = pool_.parts[slot];
    target = source;
    target.next = kNone;
    target.born_count = target.deformed_count = 0;  // grow with the faces entered, so that forget() undoes just those
    pool_.state[slot] = SlotState{};
    pool_.vertices[slot] = {position, object.summary.base_vertices + record};
    pool_.radius[slot] = radius_of(source.radius);
    loaded_[slot] = 0;
    if (before == kNone) records_.insert(key(number, record), slot);

    target.parent = parent;
    if (before == kNone && source.parent != kNone) {
      target.parent = slot_of_vertex(object, number, source.parent);
      if (target.parent == kNone) return AcceptResult::kIncomplete;
      if (target.parent == u) return AcceptResult::kMalformed;
      ring.add(target.parent);
    }
    AcceptResult result = enter_deformed(number, source, u, target, entered);
    parent = target.parent;
    if (result == AcceptResult::kAccepted && parent == kNone) result = AcceptResult::kMalformed;
    if (result == AcceptResult::kAccepted) result = enter_born(number, source, u, slot, entered);
    if (result != AcceptResult::kAccepted) return result;
    if (before == kNone) {
      if (!place(object, ring, offset, position)) return AcceptResult::kMalformed;
      pool_.vertices[slot].position = position;
    }
    more = source.next != kNone;
    if (more && source.next != part + 1) return AcceptResult::kMalformed;
    ++part;
  }
  front_.join(entered.faces);
  checksums_[u] = checksum_of(object.summary.base_vertices + record, ring,
                              [this](std::uint32_t slot_of) { return pool_.vertices[slot_of].id; });
  return AcceptResult::kAccepted;
}

void Cache::forget(ObjectIndex number, std::uint32_t first_slot) noexcept {
  const Object& object = objects_[index(number)];
  records_.erase(key(number, pool_.vertices[first_slot].id - object.summary.base_vertices));
  for (std::uint32_t slot = first_slot; slot != kNone;) {
    const RecordPart& part = pool_.parts[slot];
    TACTUS_CHECK(pool_.state[slot].bits == 0);
    for (int i = 0; i < part.deformed_count; ++i) {
      std::uint32_t& corner = front_.corners(part.deformed[i].face())[part.deformed[i].corner()];
      TACTUS_CHECK(corner == first_slot);
      corner = part.parent;
    }
    for (int i = 0; i < part.born_count; ++i) {
      front_.take_out(2 * slot + static_cast<std::uint32_t>(i), part.born[i].order());
      faces_.erase(key(number, part.born[i].face()));
    }
    const std::uint32_t next = part.next;
    free_.give(slot);
    slot = next;
  }
}

AcceptResult Cache::accept(ObjectIndex number, const RegionData& data, RegionList& out) noexcept {
  Object& object = objects_[index(number)];
  if (index(data.region) >= object.first_blocks.size()) return AcceptResult::kMalformed;
  if (object.first_blocks[index(data.region)] != kNone) return AcceptResult::kHeld;
  const Span<const Interval> list{data.list};
  const Span<const Interval> sent{data.sent};
  if (!well_formed(list, object.summary.records) || !well_formed(sent, object.summary.records) ||
      total(list) != object.record_counts[index(data.region)] || total(sent) != data.offsets.size())
    return AcceptResult::kMalformed;
  const auto length = static_cast<std::uint32_t>(total(list));
  if (ListBlock::blocks_for(length) > free_block_count_) return AcceptResult::kPoolFull;

  RegionList made;
  std::uint32_t block = kNone;
  const auto append = [&](std::uint32_t slot) noexcept {
    const std::uint32_t place = made.length % ListBlock::kEntries;
    if (place == 0) {
      const std::uint32_t before = block;
      block = free_blocks_[--free_block_count_];
      pool_.blocks[block].before = before;
      pool_.blocks[block].after = kNone;
      if (before == kNone)
        made.first_block = block;
      else
        pool_.blocks[before].after = block;
    }
    if (slot == kNone) return;
    pool_.blocks[block].slots[place] = slot;
    ++made.length;
  };
  if (length == 0) append(kNone);

  AcceptResult result = AcceptResult::kAccepted;
  std::size_t hint = 0;
  std::uint32_t part = 0;
  std::uint32_t position = 0;
  std::uint32_t checksum = 0;
  std::uint64_t repeated = 0, fresh = 0;
  for (const Interval& run : list) {
    for (std::uint32_t record = run.first; record < run.first + run.count; ++record) {
      const bool is_sent = in_runs(sent, record, hint);
      std::uint32_t slot = records_.find(key(number, record));
      if (slot != kNone && is_sent) {  // here already: skip its parts
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
          result = decode(number, record, data, part, data.offsets[position++]);
          if (result != AcceptResult::kAccepted && records_.find(key(number, record)) != kNone) forget(number, slot);
          ++fresh;
        }
      }
      if (result == AcceptResult::kAccepted && loaded_[slot] == kMaxLists) result = AcceptResult::kPoolFull;
      if (result != AcceptResult::kAccepted) break;
      ++loaded_[slot];
      checksum += checksums_[slot];
      append(slot);
    }
    if (result != AcceptResult::kAccepted) break;
  }
  if (result == AcceptResult::kAccepted && (part != data.parts.size() || position != data.offsets.size() ||
                                            checksum != object.checksums[index(data.region)]))
    result = AcceptResult::kMalformed;
  if (result != AcceptResult::kAccepted) {
    if (made.first_block != kNone) release_list(number, made);
    return result;
  }
  counters_.records_accepted += fresh;
  counters_.records_repeated += repeated;
  object.first_blocks[index(data.region)] = made.first_block;
  out = made;
  return AcceptResult::kAccepted;
}

void Cache::release_list(ObjectIndex number, const RegionList& list) noexcept {
  // From the back: a record goes before those that it names.
  std::uint32_t block = list.first_block;
  while (pool_.blocks[block].after != kNone) block = pool_.blocks[block].after;
  std::uint32_t left = list.length;
  while (block != kNone) {
    const std::uint32_t in_block = left == 0 ? 0 : (left - 1) % ListBlock::kEntries + 1;
    for (std::uint32_t i = in_block; i-- > 0;) {
      const std::uint32_t slot = pool_.blocks[block].slots[i];
      if (--loaded_[slot] == 0) forget(number, slot);
    }
    left -= in_block;
    const std::uint32_t before = pool_.blocks[block].before;
    free_blocks_[free_block_count_++] = block;
    block = before;
  }
}

void Cache::release(ObjectIndex number, RegionId region) noexcept {
  Object& object = objects_[index(number)];
  TACTUS_CHECK(object.first_blocks[index(region)] != kNone);
  release_list(number, object.list(region));
  object.first_blocks[index(region)] = kNone;
  ++counters_.regions_released;
}

Cache::Room Cache::room_of(ObjectIndex number, RegionId region) const noexcept {
  const RegionList list = objects_[index(number)].list(region);
  Room room;
  std::uint32_t left = list.length;
  for (std::uint32_t block = list.first_block; block != kNone; block = pool_.blocks[block].after) {
    ++room.blocks;
    for (std::uint32_t i = 0; i < ListBlock::kEntries && left > 0; ++i, --left) {
      const std::uint32_t first_slot = pool_.blocks[block].slots[i];
      if (loaded_[first_slot] > 1) continue;
      for (std::uint32_t slot = first_slot; slot != kNone; slot = pool_.parts[slot].next) ++room.slots;
    }
  }
  return room;
}

bool Cache::holds(ObjectIndex object, RegionId region) const noexcept {
  return objects_[index(object)].first_blocks[index(region)] != kNone;
}

std::vector<std::string> Cache::violations() const {
  std::vector<std::string> found;
  std::vector<std::uint32_t> counted(loaded_.size(), 0);
  std::uint32_t blocks_held = 0;
  for (const Object& object : objects_)
    for (std::uint32_t region = 0; region < object.first_blocks.size(); ++region) {
      const RegionList list = object.list(RegionId{region});
      if (list.first_block == kNone) continue;
      std::uint32_t left = list.length;
      for (std::uint32_t block = list.first_block; block != kNone; block = pool_.blocks[block].after) {
        ++blocks_held;
        for (std::uint32_t i = 0; i < ListBlock::kEntries && left > 0; ++i, --left)
          ++counted[pool_.blocks[block].slots[i]];
      }
      if (left != 0) found.push_back("a region's list has " + std::to_string(left) + " entries less than its length");
    }
  if (blocks_held + free_block_count_ != pool_.settings.list_blocks)
    found.push_back(std::to_string(blocks_held) + " blocks held and " + std::to_string(free_block_count_) +
                    " free of " + std::to_string(pool_.settings.list_blocks));
  std::uint32_t chained = 0;
  for (std::uint32_t slot = 0; slot < loaded_.size(); ++slot) {
    if (loaded_[slot] == kPinned) {
      ++chained;
      continue;
    }
    if (counted[slot] > 0 && free_.has(slot)) found.push_back("slot " + std::to_string(slot) + " is listed and free");
    if (counted[slot] > 0 && counted[slot] != loaded_[slot])
      found.push_back("slot " + std::to_string(slot) + " is in " + std::to_string(counted[slot]) + " lists, counted " +
                      std::to_string(loaded_[slot]));
    if (counted[slot] > 0)
      for (std::uint32_t part = slot; part != kNone; part = pool_.parts[part].next) ++chained;
  }
  if (chained + free_.count() != pool_.settings.slots)
    found.push_back(std::to_string(chained) + " slots in use and " + std::to_string(free_.count()) + " free of " +
                    std::to_string(pool_.settings.slots));
  return found;
}

}  // namespace tactus::spm
