#include "spm/forest.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>

#include "spm/prefetch.hpp"

namespace tactus::spm {
namespace {

constexpr std::uint32_t kPrefetched = 16;  // list entries whose memory is prefetched together

}  // namespace

Forest::Forest(Pool& pool, NodePool& nodes, ObjectIndex object, const ModelSummary& summary, RegionGrid grid,
               BaseSlots base)
    : pool_{pool},
      nodes_{nodes},
      grid_{std::move(grid)},
      tree_{pool, nodes, object, summary.faces},
      base_{std::move(base)},
      states_(max_loaded(summary.regions, pool.settings)),
      state_index_{states_.size(), states_.size()},
      in_use_(states_.size()),
      targets_(states_.size()) {
  free_states_.reserve(states_.size());
  for (std::uint32_t number = states_.size(); number-- > 0;) free_states_.push_back(StateIndex{number});
}

std::uint64_t Forest::hash_of(VertexId vertex) noexcept {
  std::uint64_t z = index(vertex) + 0x9e3779b97f4a7c15ull;  // splitmix64
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ z >> 27) * 0x94d049bb133111ebull;
  return z ^ z >> 31;
}

void Forest::add_in_use(StateIndex at) noexcept {
  State& state = states_[at];
  if (state.retained) end_retention(at);
  if (state.in_use_at != kNone) return;
  state.in_use_at = in_use_count_;
  in_use_[in_use_count_++] = at;
}

void Forest::remove_in_use(StateIndex at) noexcept {
  State& state = states_[at];
  const StateIndex last = in_use_[--in_use_count_];
  in_use_[state.in_use_at] = last;
  states_[last].in_use_at = state.in_use_at;
  state.in_use_at = kNone;
}

void Forest::retain(StateIndex at) noexcept {
  remove_in_use(at);
  State& state = states_[at];
  if (state.cursor == 0) return;
  state.retained = true;
  state.older = newest_;
  state.newer = kNone;
  (newest_ != kNone ? states_[newest_].newer : oldest_) = at;
  newest_ = at;
}

void Forest::end_retention(StateIndex at) noexcept {
  State& state = states_[at];
  (state.older != kNone ? states_[state.older].newer : oldest_) = state.newer;
  (state.newer != kNone ? states_[state.newer].older : newest_) = state.older;
  state.retained = false;
}

/// Returns the number of entries of retained regions to coarsen for a target. It is one for each node above the limit,
/// so retained regions are coarsened about as fast as new ones are refined.
std::uint32_t Forest::entries_to_coarsen() const noexcept {
  if (unrequested_ == Unrequested::kCoarsen) return ~0u;
  const std::uint32_t max = retained_node_limit(pool_.settings);
  return nodes_.used_nodes() > max ? nodes_.used_nodes() - max : 0;
}

void Forest::add(RegionId region, RegionList list) noexcept {
  TACTUS_ASSERT(!is_loaded(region) && !free_states_.empty());
  const StateIndex at = free_states_.back();
  free_states_.pop_back();
  State& state = states_[at];
  state = State{};
  state.region = region;
  state.list = list;
  state.block = list.first_block;
  state_index_.insert(index(region), index(at));
}

void Forest::retire(RegionId region) noexcept {
  const StateIndex at = find(region);
  TACTUS_ASSERT(at != kNone && !states_[at].retiring);
  states_[at].retiring = true;
  ++retiring_count_;
  add_in_use(at);
}

RegionId Forest::take_retired() noexcept {
  if (retiring_count_ == 0) return kNone;
  for (std::uint32_t i = 0; i < in_use_count_; ++i) {
    const StateIndex at = in_use_[i];
    State& state = states_[at];
    if (!state.retiring || state.cursor != 0) continue;
    remove_in_use(at);
    --retiring_count_;
    const RegionId region = state.region;
    state_index_.erase(index(region), index(at), key_of_state());
    state.region = kNone;
    free_states_.push_back(at);
    return region;
  }
  return kNone;
}

void Forest::begin_target(Unrequested other_regions) noexcept {
  ++target_number_;
  unrequested_ = other_regions;
  target_count_ = 0;
}

/// Adds a region to the target. `entries`: number of entries to apply, at most all.
void Forest::add_target(RegionId region, std::uint32_t entries) noexcept {
  const StateIndex at = find(region);
  if (at == kNone) return;
  State& state = states_[at];
  if (state.retiring || state.target_number == target_number_) return;
  state.target_number = target_number_;
  state.target_entries = std::min(entries, state.list.length);
  add_in_use(at);
  targets_[target_count_++] = at;
}

void Forest::set_targets(const RegionId* regions, std::uint32_t count, Unrequested other_regions) noexcept {
  begin_target(other_regions);
  for (std::uint32_t i = 0; i < count; ++i) add_target(regions[i], ~0u);
  entries_to_coarsen_ = oldest_ != kNone ? entries_to_coarsen() : 0;
}

void Forest::set_targets(const Applied* regions, std::uint32_t count) noexcept {
  begin_target(Unrequested::kCoarsen);
  for (std::uint32_t i = 0; i < count; ++i) add_target(regions[i].region, regions[i].entries);
  entries_to_coarsen_ = oldest_ != kNone ? entries_to_coarsen() : 0;
}

const PackedSlot* Forest::entry(State& state, std::uint32_t number) noexcept {
  const std::uint32_t block_number = number / ListBlock::kEntries;
  for (; state.block_number < block_number; ++state.block_number) state.block = pool_.blocks[state.block].after;
  for (; state.block_number > block_number; --state.block_number) state.block = pool_.blocks[state.block].before;
  return &pool_.blocks[state.block].slots[number % ListBlock::kEntries];
}

/// Prefetches the memory of the next records in a list, because a dozen cache misses are most of the cost of a split.
/// There are three passes, because each pass needs addresses that the pass before has loaded.
void Forest::prefetch_records(const PackedSlot* slots, std::uint32_t count, bool splitting) const noexcept {
  const IdVector<Slot, LoadedPart>& parts = pool_.parts;
  const IdVector<RowIndex, LeafLane>& rows = pool_.shown_at;
  const IdVector<Slot, Vertex>& vertices = pool_.vertices;
  std::array<Slot, kPrefetched> changing;
  std::uint32_t changes = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    const SlotState state = pool_.state[slots[i]];
    if (splitting ? state.shown() : state.wanted() > 1) continue;
    prefetch(&parts[slots[i]]);
    changing[changes++] = slots[i];
  }
  for (std::uint32_t i = 0; i < changes; ++i) {
    const Slot slot = changing[i];
    const LoadedPart& part = parts[slot];
    prefetch(&rows[row_of(slot, 0)]);
    prefetch(&vertices[splitting ? slot : part.parent]);
    for (std::uint32_t k = 0; k < part.deformed_count; ++k) prefetch(&rows[part.deformed(k).face()]);
    if (!splitting) continue;
    for (int k = 0; k < part.born_count; ++k) {
      tree_.prefetch_entry(part.born[k].face());
      prefetch(&vertices[part.born_x[k]]);
    }
  }
  for (std::uint32_t i = 0; i < changes; ++i) {
    const Slot slot = changing[i];
    const LoadedPart& part = parts[slot];
    for (std::uint32_t k = 0; k < part.deformed_count; ++k) {
      const LoadedPart::DeformedRef ref = part.deformed(k);
      tree_.prefetch_update(rows[ref.face()], ref.corner());
    }
    for (std::uint32_t k = 0; k < part.born_count; ++k) {
      if (splitting)
        tree_.prefetch_insert(part.born[k].face());
      else
        tree_.prefetch_remove(rows[row_of(slot, k)]);
    }
  }
}

bool Forest::has_tree_nodes_for(Slot slot) const noexcept {
  std::uint32_t faces = 0;
  for (; slot != kNone; slot = pool_.parts[slot].next) faces += pool_.parts[slot].born_count;
  return nodes_.free_nodes() >= faces * tree_.height();
}

bool Forest::has_previous_nodes_for(Slot slot) const noexcept {
  std::uint32_t faces = 0;
  for (; slot != kNone; slot = pool_.parts[slot].next)
    faces += std::uint32_t{pool_.parts[slot].born_count} + pool_.parts[slot].deformed_count;
  return tree_.free_previous_nodes() >= faces;
}

void Forest::show_base_face(const BaseSlots::Face& face) noexcept {
  const BornRef ref = pool_.born(face.row);
  tree_.insert(face.row, ref.face(), face.corners, ref.is_finest());
}

void Forest::split(Slot slot) noexcept {
  const Vertex& vertex = pool_.vertices[slot];
  for_each_change(
      pool_.parts, slot, slot,
      [&](LoadedPart::DeformedRef ref) { tree_.update(ref.face(), ref.corner(), vertex, ref.is_finest()); },
      [&](BornRef ref, const std::array<Slot, 3>& corners, Slot part, std::uint32_t i) {
        tree_.insert(row_of(part, i), ref.face(), corners, ref.is_finest());
      });
  pool_.state[slot].bits |= SlotState::kShown;
  hash_ ^= hash_of(vertex.id);
  ++counters_.splits;
}

/// Undoes a split.
void Forest::collapse(Slot slot) noexcept {
  const IdVector<Slot, LoadedPart>& parts = pool_.parts;
  const Slot parent = parts[slot].parent;
  const Vertex& vertex = pool_.vertices[parent];
  for (Slot at = slot; at != kNone; at = parts[at].next) {
    const LoadedPart& part = parts[at];
    for (std::uint32_t i = 0; i < part.born_count; ++i) tree_.remove(row_of(at, i));
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
      const LoadedPart::DeformedRef ref = part.deformed(i);
      tree_.update(ref.face(), ref.corner(), vertex, false);
    }
  }
  pool_.state[slot].bits &= static_cast<std::uint16_t>(~SlotState::kShown);
  hash_ ^= hash_of(pool_.vertices[slot].id);
  ++counters_.collapses;
}

Advance Forest::refine(State& state, Budget& budget) noexcept {
  while (state.cursor < state.target_entries) {
    const PackedSlot* slots = entry(state, state.cursor);
    const std::uint32_t count = std::min(
        {kPrefetched, state.target_entries - state.cursor, ListBlock::kEntries - state.cursor % ListBlock::kEntries});
    prefetch_records(slots, count, true);
    for (std::uint32_t i = 0; i < count; ++i) {
      if (budget.units < Budget::kVisit) return Advance::kBudget;
      SlotState& record = pool_.state[slots[i]];
      if (!record.shown()) {
        if (budget.units < Budget::kVisit + Budget::kChange) return Advance::kBudget;
        if (!has_tree_nodes_for(slots[i])) return Advance::kNodesFull;
        if (!has_previous_nodes_for(slots[i])) return Advance::kPreviousFull;
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

/// Coarsens at most `entries` list entries and subtracts them from `entries`.
Advance Forest::coarsen(State& state, Budget& budget, std::uint32_t& entries) noexcept {
  while (state.cursor > 0 && entries > 0) {
    const PackedSlot* last = entry(state, state.cursor - 1);
    const std::uint32_t count = std::min({kPrefetched, (state.cursor - 1) % ListBlock::kEntries + 1, entries});
    prefetch_records(last - (count - 1), count, false);
    for (std::uint32_t i = 0; i < count; ++i) {
      if (budget.units < Budget::kVisit + Budget::kChange) return Advance::kBudget;
      const Slot slot = *(last - i);
      SlotState& record = pool_.state[slot];
      TACTUS_ASSERT(record.wanted() > 0 && record.shown());
      if (record.wanted() == 1 && !has_previous_nodes_for(slot)) return Advance::kPreviousFull;
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

/// Collapses all records, then hides the base mesh.
Advance Forest::hide_all(Budget& budget) noexcept {
  std::uint32_t all = ~0u;
  for (std::uint32_t i = in_use_count_; i-- > 0;) {
    const StateIndex at = in_use_[i];
    State& state = states_[at];
    if (const Advance coarsening = coarsen(state, budget, all); coarsening != Advance::kDone) return coarsening;
    if (!state.retiring) remove_in_use(at);
  }
  while (oldest_ != kNone) {
    const StateIndex at = oldest_;
    if (const Advance coarsening = coarsen(states_[at], budget, all); coarsening != Advance::kDone) return coarsening;
    end_retention(at);
  }
  for (; base_cursor_ > 0; --base_cursor_) {
    if (budget.units < Budget::kChange) return Advance::kBudget;
    if (tree_.free_previous_nodes() == 0) return Advance::kPreviousFull;
    tree_.remove(base_.faces[base_cursor_ - 1].row);
    budget.units -= Budget::kChange;
  }
  return Advance::kDone;
}

Advance Forest::advance(Budget& budget) noexcept {
  if (withdrawn_) return hide_all(budget);
  for (; !is_base_shown(); ++base_cursor_) {
    if (budget.units < Budget::kChange) return Advance::kBudget;
    if (nodes_.free_nodes() < tree_.height()) return Advance::kNodesFull;
    if (tree_.free_previous_nodes() == 0) return Advance::kPreviousFull;
    show_base_face(base_.faces[base_cursor_]);
    budget.units -= Budget::kChange;
  }
  Advance refining = Advance::kDone;
  for (std::uint32_t i = 0; i < target_count_ && refining == Advance::kDone; ++i)
    if (State& state = states_[targets_[i]]; is_target(state)) refining = refine(state, budget);
  if (refining == Advance::kBudget || refining == Advance::kPreviousFull) return refining;

  for (std::uint32_t i = in_use_count_; i-- > 0;) {
    const StateIndex at = in_use_[i];
    State& state = states_[at];
    if (is_target(state)) {
      std::uint32_t excess = state.cursor > state.target_entries ? state.cursor - state.target_entries : 0;
      if (const Advance coarsening = coarsen(state, budget, excess); coarsening != Advance::kDone) return coarsening;
      continue;
    }
    if (unrequested_ == Unrequested::kRetain && !state.retiring) {
      retain(at);
      continue;
    }
    std::uint32_t all = ~0u;
    if (const Advance coarsening = coarsen(state, budget, all); coarsening != Advance::kDone) return coarsening;
    if (!state.retiring) remove_in_use(at);
  }
  if (refining == Advance::kNodesFull)
    entries_to_coarsen_ = ~0u;  // coarsen all retained regions while the target needs nodes
  while (oldest_ != kNone && entries_to_coarsen_ > 0) {
    const StateIndex at = oldest_;
    State& state = states_[at];
    if (const Advance coarsening = coarsen(state, budget, entries_to_coarsen_); coarsening != Advance::kDone)
      return coarsening;
    if (state.cursor == 0) end_retention(at);
  }
  return refining;
}

std::uint32_t Forest::copy_in_use(InUse* out, std::uint32_t capacity) const noexcept {
  for (std::uint32_t i = 0; i < in_use_count_ && i < capacity; ++i) {
    const State& state = states_[in_use_[i]];
    out[i] = {state.region, state.cursor, state.retiring, false};
  }
  std::uint32_t count = in_use_count_;
  for (StateIndex at = oldest_; at != kNone; ++count) {
    if (capacity > 0 && count > capacity) break;
    const State& state = states_[at];
    if (count < capacity) out[count] = {state.region, state.cursor, false, true};
    at = state.newer;
  }
  return count;
}

bool Forest::restore(std::uint32_t base_faces, const InUse* regions, std::uint32_t count) noexcept {
  if (base_faces > base_.faces.size() || base_cursor_ > 0) return false;
  for (; base_cursor_ < base_faces; ++base_cursor_) {
    if (nodes_.free_nodes() < tree_.height() || tree_.free_previous_nodes() == 0) return false;
    show_base_face(base_.faces[base_cursor_]);
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    const StateIndex at = find(regions[i].region);
    if (at == kNone) return false;
    State& state = states_[at];
    if (state.in_use_at != kNone || state.retained || regions[i].applied > state.list.length) return false;
    if (regions[i].applied > 0 && !is_base_shown()) return false;  // no record is split before the base mesh is shown
    if (regions[i].retained && (regions[i].retiring || regions[i].applied == 0)) return false;
    add_in_use(at);
    for (; state.cursor < regions[i].applied; ++state.cursor) {
      const Slot slot = *entry(state, state.cursor);
      SlotState& record = pool_.state[slot];
      if (!record.shown()) {
        if (!has_tree_nodes_for(slot) || !has_previous_nodes_for(slot)) return false;
        split(slot);
      }
      ++record.bits;
    }
    if (regions[i].retiring) retire(state.region);
    if (regions[i].retained) retain(at);
  }
  static_cast<void>(tree_.refit());
  return true;
}

bool Forest::is_exact(const Vec3d& centre, double radius) const noexcept {
  bool all = is_base_shown();
  const bool seen =
      grid_.for_each_intersecting(centre, radius, [&](RegionId region, double) { all = all && is_refined(region); });
  return all && seen && grid_.has_pages(centre, radius);
}

std::map<RowIndex, Forest::ShownFace> Forest::shown_faces() const {
  std::map<VertexId, Slot> shown;  // records in topological order
  for (const State& state : states_) {
    std::uint32_t left = state.cursor;
    for (BlockIndex block = state.list.first_block; left > 0; block = pool_.blocks[block].after)
      for (std::uint32_t i = 0; i < ListBlock::kEntries && left > 0; ++i, --left) {
        const Slot slot = pool_.blocks[block].slots[i];
        shown[pool_.vertices[slot].id] = slot;
      }
  }
  std::map<RowIndex, ShownFace> faces;
  for (std::size_t i = 0; i < base_cursor_; ++i)
    faces[base_.faces[i].row] = {base_.faces[i].corners, pool_.born(base_.faces[i].row).is_finest()};
  for (const auto& entry : shown) {
    const Slot slot = entry.second;
    for_each_change(
        pool_.parts, slot, slot,
        [&](LoadedPart::DeformedRef ref) {
          ShownFace& face = faces[ref.face()];
          face.corners[ref.corner()] = slot;
          face.is_finest = ref.is_finest();
        },
        [&](BornRef ref, const std::array<Slot, 3>& corners, Slot part, std::uint32_t i) {
          faces[row_of(part, i)] = {corners, ref.is_finest()};
        });
  }
  return faces;
}

std::vector<std::string> Forest::violations() const {
  std::vector<std::string> found;
  std::map<Slot, std::uint32_t> wanted;  // number of applied entries of each record
  for (const StateIndex at : states_.ids()) {
    const State& state = states_[at];
    if (state.region == kNone) continue;
    const std::string name = "region " + std::to_string(index(state.region));
    if (find(state.region) != at) found.push_back(name + " is loaded, but not in the index");
    if (state.cursor > state.list.length) found.push_back(name + " has more applied entries than its list");
    if (state.cursor > 0 && state.in_use_at == kNone && !state.retained)
      found.push_back(name + " has applied entries but is neither in use nor retained");
    std::uint32_t left = state.cursor;
    for (BlockIndex block = state.list.first_block; left > 0; block = pool_.blocks[block].after)
      for (std::uint32_t i = 0; i < ListBlock::kEntries && left > 0; ++i, --left)
        ++wanted[pool_.blocks[block].slots[i]];
  }
  std::uint64_t hash = 0;
  for (const auto& [slot, count] : wanted) {
    const SlotState state = pool_.state[slot];
    const std::string name = "record of vertex " + std::to_string(index(pool_.vertices[slot].id));
    if (state.wanted() != count)
      found.push_back(name + " is wanted " + std::to_string(state.wanted()) + " times, counted " +
                      std::to_string(count));
    if (!state.shown()) found.push_back(name + " is wanted but not shown");
    hash ^= hash_of(pool_.vertices[slot].id);
  }
  if (hash != hash_) found.push_back("the mesh hash differs from a recount: a record is shown but not wanted");
  const std::map<RowIndex, ShownFace> expected = shown_faces();
  for (const auto& [row, face] : expected) {
    const LeafLane at = pool_.shown_at[row];
    const std::string name = "face " + std::to_string(index(pool_.face_of(row)));
    if (!at.is_shown()) {
      found.push_back(name + " should be shown");
      continue;
    }
    if (tree_.face(at) != pool_.face_of(row)) found.push_back(name + " is shown in the lane of another face");
    if (tree_.is_finest(at) != face.is_finest) found.push_back(name + " has a wrong version");
    const std::array<float, 9> shown = tree_.corners(at);
    for (std::size_t i = 0; i < 3; ++i)
      if (std::memcmp(&shown[3 * i], &pool_.vertices[face.corners[i]].position, 3 * sizeof(float)) != 0)
        found.push_back(name + " is not shown with vertex " +
                        std::to_string(index(pool_.vertices[face.corners[i]].id)));
  }
  if (const std::size_t shown = tree_.shown().size(); shown != expected.size())
    found.push_back(std::to_string(shown) + " faces are shown, expected " + std::to_string(expected.size()));
  for (std::string& text : tree_.violations()) found.push_back(std::move(text));
  return found;
}

}  // namespace tactus::spm
