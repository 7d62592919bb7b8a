#include "spm/forest.hpp"

#include <algorithm>
#include <array>
#include <map>

#include "spm/prefetch.hpp"

namespace tactus::spm {
namespace {

constexpr std::uint32_t kFetched = 16;  // list entries whose memory is asked for together

}  // namespace

Forest::Forest(Pool& pool, NodePool& nodes, std::uint32_t object, const ModelSummary& summary, RegionGrid grid,
               BaseSlots base)
    : pool_{pool},
      nodes_{nodes},
      grid_{std::move(grid)},
      tree_{pool, nodes, object, summary.faces},
      base_{std::move(base)},
      place_(grid_.size(), kNone),
      states_(max_held(grid_.size(), pool.settings)),
      in_use_(states_.size()),
      order_(states_.size()) {
  free_states_.reserve(states_.size());
  for (auto number = static_cast<std::uint32_t>(states_.size()); number-- > 0;) free_states_.push_back(number);
}

std::uint64_t Forest::hash_of(std::uint32_t vertex_id) noexcept {
  std::uint64_t z = vertex_id + 0x9e3779b97f4a7c15ull;  // splitmix64
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ z >> 27) * 0x94d049bb133111ebull;
  return z ^ z >> 31;
}

void Forest::use(RegionId region) noexcept {
  State& state = state_of(region);
  if (state.resting) wake(region);
  if (state.in_use_at != kNone) return;
  state.in_use_at = in_use_count_;
  in_use_[in_use_count_++] = region;
}

void Forest::unuse(RegionId region) noexcept {
  State& state = state_of(region);
  const RegionId last = in_use_[--in_use_count_];
  in_use_[state.in_use_at] = last;
  state_of(last).in_use_at = state.in_use_at;
  state.in_use_at = kNone;
}

void Forest::rest(RegionId region) noexcept {
  unuse(region);
  State& state = state_of(region);
  if (state.cursor == 0) return;
  state.resting = true;
  state.older = newest_;
  state.newer = kNone;
  (newest_ != kNone ? state_of(RegionId{newest_}).newer : oldest_) = index(region);
  newest_ = index(region);
}

void Forest::wake(RegionId region) noexcept {
  State& state = state_of(region);
  (state.older != kNone ? state_of(RegionId{state.older}).newer : oldest_) = state.newer;
  (state.newer != kNone ? state_of(RegionId{state.newer}).older : newest_) = state.older;
  state.resting = false;
}

/// One for each node that is too many: what was left to rest goes about as fast as new regions come.
std::uint32_t Forest::overdue() const noexcept {
  if (unrequested_ == Unrequested::kCoarsen) return ~0u;
  const std::uint32_t max = max_resting(pool_.settings);
  return nodes_.used() > max ? nodes_.used() - max : 0;
}

void Forest::add(RegionId region, RegionList list) noexcept {
  TACTUS_ASSERT(!is_here(region) && !free_states_.empty());
  place_[index(region)] = free_states_.back();
  free_states_.pop_back();
  State& state = state_of(region);
  state = State{};
  state.list = list;
  state.block = list.first_block;
}

void Forest::retire(RegionId region) noexcept {
  TACTUS_ASSERT(is_here(region) && !is_retiring(region));
  state_of(region).retiring = true;
  ++retiring_count_;
  use(region);
}

std::uint32_t Forest::take_retired() noexcept {
  if (retiring_count_ == 0) return kNone;
  for (std::uint32_t i = 0; i < in_use_count_; ++i) {
    const RegionId region = in_use_[i];
    const State& state = state_of(region);
    if (!state.retiring || state.cursor != 0) continue;
    unuse(region);
    --retiring_count_;
    free_states_.push_back(place_[index(region)]);
    place_[index(region)] = kNone;
    return index(region);
  }
  return kNone;
}

void Forest::target(const RegionId* regions, std::uint32_t count, Unrequested unrequested) noexcept {
  ++stamp_;
  unrequested_ = unrequested;
  order_count_ = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (!is_here(regions[i])) continue;
    State& state = state_of(regions[i]);
    if (state.retiring || state.requested == stamp_) continue;
    state.requested = stamp_;
    use(regions[i]);
    order_[order_count_++] = regions[i];
  }
  overdue_ = oldest_ != kNone ? overdue() : 0;
}

const std::uint32_t* Forest::entry(State& state, std::uint32_t number) noexcept {
  const std::uint32_t block_number = number / ListBlock::kEntries;
  for (; state.block_number < block_number; ++state.block_number) state.block = pool_.blocks[state.block].after;
  for (; state.block_number > block_number; --state.block_number) state.block = pool_.blocks[state.block].before;
  return &pool_.blocks[state.block].slots[number % ListBlock::kEntries];
}

/// Memory is what a split costs: a dozen places that nothing near in time has touched. The list names the next records,
/// so what all of them will touch is asked for at once, in the order in which one place leads to the next.
void Forest::fetch(const std::uint32_t* slots, std::uint32_t count, bool splitting) const noexcept {
  const RecordPart* parts = pool_.parts.data();
  const FaceRow* rows = pool_.faces.data();
  const Vertex* vertices = pool_.vertices.data();
  std::array<std::uint32_t, kFetched> changing;
  std::uint32_t changes = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    const SlotState state = pool_.state[slots[i]];
    if (splitting ? state.shown() : state.wanted() > 1) continue;
    prefetch(&parts[slots[i]]);
    changing[changes++] = slots[i];
  }
  for (std::uint32_t i = 0; i < changes; ++i) {
    const std::uint32_t slot = changing[i];
    const RecordPart& part = parts[slot];
    prefetch(&rows[2 * slot]);
    prefetch(&vertices[splitting ? slot : part.parent]);
    for (int k = 0; k < part.deformed_count; ++k) prefetch(&rows[part.deformed[k].face()]);
    if (!splitting) continue;
    for (int k = 0; k < part.born_count; ++k) {
      tree_.prefetch_entry(part.born[k].face());
      prefetch(&vertices[part.born_x[k]]);
    }
  }
  for (std::uint32_t i = 0; i < changes; ++i) {
    const std::uint32_t slot = changing[i];
    const RecordPart& part = parts[slot];
    for (int k = 0; k < part.deformed_count; ++k)
      tree_.prefetch_update(rows[part.deformed[k].face()], part.deformed[k].corner());
    for (std::uint32_t k = 0; k < part.born_count; ++k) {
      if (splitting)
        tree_.prefetch_insert(part.born[k].face());
      else
        tree_.prefetch_remove(rows[2 * slot + k]);
    }
  }
}

bool Forest::room_for(std::uint32_t slot) const noexcept {
  std::uint32_t faces = 0;
  for (; slot != kNone; slot = pool_.parts[slot].next) faces += pool_.parts[slot].born_count;
  return nodes_.free() >= faces * tree_.height();
}

bool Forest::room_to_keep(std::uint32_t slot) const noexcept {
  std::uint32_t faces = 0;
  for (; slot != kNone; slot = pool_.parts[slot].next)
    faces += std::uint32_t{pool_.parts[slot].born_count} + pool_.parts[slot].deformed_count;
  return tree_.room_to_keep() >= faces;
}

void Forest::split(std::uint32_t slot) noexcept {
  const RecordPart* parts = pool_.parts.data();
  FaceRow* rows = pool_.faces.data();
  const Vertex& vertex = pool_.vertices[slot];
  for (std::uint32_t at = slot; at != kNone; at = parts[at].next) {
    const RecordPart& part = parts[at];
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
      const DeformedRef ref = part.deformed[i];
      FaceRow& row = rows[ref.face()];
      row.vertices[ref.corner()] = slot;
      row.last = ref.last();
      tree_.update(row, ref.corner(), vertex, ref.last());
    }
    for (std::uint32_t i = 0; i < part.born_count; ++i) {
      const BornRef born = part.born[i];
      const BornCorners corners = born_corners(born.order());
      FaceRow& row = rows[2 * at + i];
      row.vertices[corners.u] = slot;
      row.vertices[corners.t] = part.parent;
      row.vertices[corners.x] = part.born_x[i];
      row.last = born.last();
      tree_.insert(2 * at + i);
    }
  }
  pool_.state[slot].bits |= SlotState::kShown;
  hash_ ^= hash_of(vertex.id);
  ++counters_.splits;
}

void Forest::collapse(std::uint32_t slot) noexcept {
  const RecordPart* parts = pool_.parts.data();
  FaceRow* rows = pool_.faces.data();
  const std::uint32_t parent = parts[slot].parent;
  const Vertex& vertex = pool_.vertices[parent];
  for (std::uint32_t at = slot; at != kNone; at = parts[at].next) {
    const RecordPart& part = parts[at];
    for (std::uint32_t i = 0; i < part.born_count; ++i) tree_.remove(2 * at + i);
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
      const DeformedRef ref = part.deformed[i];
      FaceRow& row = rows[ref.face()];
      row.vertices[ref.corner()] = parent;
      row.last = 0;
      tree_.update(row, ref.corner(), vertex, false);
    }
  }
  pool_.state[slot].bits &= static_cast<std::uint16_t>(~SlotState::kShown);
  hash_ ^= hash_of(pool_.vertices[slot].id);
  ++counters_.collapses;
}

Advance Forest::refine(State& state, Budget& budget) noexcept {
  while (state.cursor < state.list.length) {
    const std::uint32_t* slots = entry(state, state.cursor);
    const std::uint32_t count = std::min(
        {kFetched, state.list.length - state.cursor, ListBlock::kEntries - state.cursor % ListBlock::kEntries});
    fetch(slots, count, true);
    for (std::uint32_t i = 0; i < count; ++i) {
      if (budget.units < Budget::kVisit) return Advance::kBudget;
      SlotState& record = pool_.state[slots[i]];
      if (!record.shown()) {
        if (budget.units < Budget::kVisit + Budget::kChange) return Advance::kBudget;
        if (!room_for(slots[i])) return Advance::kNodesFull;
        if (!room_to_keep(slots[i])) return Advance::kKeptFull;
        split(slots[i]);
        budget.units -= Budget::kChange;
      }
      TACTUS_ASSERT(record.wanted() < 0x7fff);
      ++record.bits;
      ++state.cursor;
      budget.units -= Budget::kVisit;
      ++counters_.visits;
    }
  }
  return Advance::kDone;
}

/// Takes back at most `entries`, and counts them off.
Advance Forest::coarsen(State& state, Budget& budget, std::uint32_t& entries) noexcept {
  while (state.cursor > 0 && entries > 0) {
    const std::uint32_t* last = entry(state, state.cursor - 1);
    const std::uint32_t count = std::min({kFetched, (state.cursor - 1) % ListBlock::kEntries + 1, entries});
    fetch(last - (count - 1), count, false);
    for (std::uint32_t i = 0; i < count; ++i) {
      if (budget.units < Budget::kVisit + Budget::kChange) return Advance::kBudget;
      const std::uint32_t slot = *(last - i);
      SlotState& record = pool_.state[slot];
      TACTUS_ASSERT(record.wanted() > 0 && record.shown());
      if (record.wanted() == 1 && !room_to_keep(slot)) return Advance::kKeptFull;
      --record.bits;
      --state.cursor;
      --entries;
      budget.units -= Budget::kVisit;
      ++counters_.visits;
      if (record.wanted() > 0) continue;
      collapse(slot);
      budget.units -= Budget::kChange;
    }
  }
  return Advance::kDone;
}

Advance Forest::advance(Budget& budget) noexcept {
  for (; !base_shown(); ++base_cursor_) {
    if (budget.units < Budget::kChange) return Advance::kBudget;
    if (nodes_.free() < tree_.height()) return Advance::kNodesFull;
    if (tree_.room_to_keep() == 0) return Advance::kKeptFull;
    tree_.insert(base_.faces[base_cursor_]);
    budget.units -= Budget::kChange;
  }
  Advance refining = Advance::kDone;
  for (std::uint32_t i = 0; i < order_count_ && refining == Advance::kDone; ++i) {
    if (!is_here(order_[i])) continue;  // retired and gone since it was asked for
    if (State& state = state_of(order_[i]); wants(state)) refining = refine(state, budget);
  }
  if (refining == Advance::kBudget || refining == Advance::kKeptFull) return refining;

  for (std::uint32_t i = in_use_count_; i-- > 0;) {
    const RegionId region = in_use_[i];
    State& state = state_of(region);
    if (wants(state)) continue;
    if (unrequested_ == Unrequested::kRest && !state.retiring) {
      rest(region);
      continue;
    }
    std::uint32_t all = ~0u;
    if (const Advance coarsening = coarsen(state, budget, all); coarsening != Advance::kDone) return coarsening;
    if (!state.retiring) unuse(region);
  }
  if (refining == Advance::kNodesFull) overdue_ = ~0u;  // nothing rests while what is asked for lacks a node
  while (oldest_ != kNone && overdue_ > 0) {
    const RegionId region{oldest_};
    State& state = state_of(region);
    if (const Advance coarsening = coarsen(state, budget, overdue_); coarsening != Advance::kDone) return coarsening;
    if (state.cursor == 0) wake(region);
  }
  return refining;
}

std::uint32_t Forest::in_use(InUse* out, std::uint32_t capacity) const noexcept {
  for (std::uint32_t i = 0; i < in_use_count_ && i < capacity; ++i) {
    const State& state = state_of(in_use_[i]);
    out[i] = {in_use_[i], state.cursor, state.retiring, false};
  }
  std::uint32_t count = in_use_count_;
  for (std::uint32_t region = oldest_; region != kNone; ++count) {
    const State& state = state_of(RegionId{region});
    if (count < capacity) out[count] = {RegionId{region}, state.cursor, false, true};
    region = state.newer;
  }
  return count;
}

bool Forest::restore(std::uint32_t base_faces, const InUse* regions, std::uint32_t count) noexcept {
  if (base_faces > base_.faces.size() || base_cursor_ > 0) return false;
  for (; base_cursor_ < base_faces; ++base_cursor_) {
    if (nodes_.free() < tree_.height() || tree_.room_to_keep() == 0) return false;
    tree_.insert(base_.faces[base_cursor_]);
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    const RegionId region = regions[i].region;
    if (index(region) >= place_.size() || !is_here(region)) return false;
    State& state = state_of(region);
    if (state.in_use_at != kNone || state.resting || regions[i].applied > state.list.length) return false;
    if (regions[i].applied > 0 && !base_shown()) return false;  // records are split once the base is shown
    if (regions[i].resting && (regions[i].retiring || regions[i].applied == 0)) return false;
    use(region);
    for (; state.cursor < regions[i].applied; ++state.cursor) {
      const std::uint32_t slot = *entry(state, state.cursor);
      SlotState& record = pool_.state[slot];
      if (!record.shown()) {
        if (!room_for(slot) || !room_to_keep(slot)) return false;
        split(slot);
      }
      ++record.bits;
    }
    if (regions[i].retiring) retire(region);
    if (regions[i].resting) rest(region);
  }
  static_cast<void>(tree_.refit());
  return true;
}

bool Forest::exact(const Vec3d& centre, double radius) const noexcept {
  bool all = base_shown();
  const bool seen =
      grid_.for_each_meeting(centre, radius, [&](RegionId region, double) { all = all && is_refined(region); });
  return all && seen;
}

std::vector<std::string> Forest::violations() const {
  std::vector<std::string> found;
  std::map<std::uint32_t, std::uint32_t> wanted;  // by slot, over the applied prefixes
  for (std::uint32_t region = 0; region < place_.size(); ++region) {
    if (!is_here(RegionId{region})) continue;
    const State& state = state_of(RegionId{region});
    if (state.cursor > state.list.length) found.push_back("region " + std::to_string(region) + " is past its end");
    if (state.cursor > 0 && state.in_use_at == kNone && !state.resting)
      found.push_back("region " + std::to_string(region) + " is refined and not in use");
    std::uint32_t left = state.cursor;
    for (std::uint32_t block = state.list.first_block; left > 0; block = pool_.blocks[block].after)
      for (std::uint32_t i = 0; i < ListBlock::kEntries && left > 0; ++i, --left)
        ++wanted[pool_.blocks[block].slots[i]];
  }
  std::uint64_t hash = 0;
  std::map<std::uint32_t, bool> expected_rows;
  for (std::size_t i = 0; i < base_cursor_; ++i) expected_rows[base_.faces[i]] = true;
  for (const auto& [slot, count] : wanted) {
    const SlotState state = pool_.state[slot];
    const std::string name = "record of vertex " + std::to_string(pool_.vertices[slot].id);
    if (state.wanted() != count)
      found.push_back(name + " is wanted " + std::to_string(state.wanted()) + " times, counted " +
                      std::to_string(count));
    if (!state.shown()) found.push_back(name + " is wanted and not shown");
    hash ^= hash_of(pool_.vertices[slot].id);
    for (std::uint32_t at = slot; at != kNone; at = pool_.parts[at].next)
      for (std::uint32_t i = 0; i < pool_.parts[at].born_count; ++i) expected_rows[2 * at + i] = true;
  }
  if (hash != hash_) found.push_back("the mesh hash differs from a recount: some record is shown and not wanted");
  const std::vector<std::uint32_t> shown = tree_.shown();
  for (const std::uint32_t row_index : shown) {
    const FaceRow& row = pool_.faces[row_index];
    if (expected_rows.erase(row_index) == 0)
      found.push_back("face " + std::to_string(row.face) + " is shown by no record");
    for (int i = 0; i < 3; ++i) {
      const Vertex& vertex = pool_.vertices[row.vertices[i]];
      const bool is_record = pool_.state[row.vertices[i]].shown();
      const bool is_base = pool_.state[row.vertices[i]].bits == 0 && wanted.count(row.vertices[i]) == 0;
      if (!is_record && !is_base)
        found.push_back("face " + std::to_string(row.face) + " stands on vertex " + std::to_string(vertex.id) +
                        ", not shown");
    }
  }
  if (!expected_rows.empty())
    found.push_back(std::to_string(expected_rows.size()) + " faces that should be shown are not");
  for (std::string& text : tree_.violations()) found.push_back(std::move(text));
  return found;
}

}  // namespace tactus::spm
