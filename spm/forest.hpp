/// The vertex forest of one object in the haptic thread. It stores which records are shown (the refined front), and
/// refines and coarsens regions as the contact moves.
///
/// To refine a region, the forest walks its list forwards: it increments the count of each record and splits the
/// records that are not shown. To coarsen a region, it walks the list backwards: it decrements the count of each record
/// and collapses the records whose count becomes 0. A record in the lists of two regions is therefore split once.
/// Records are in topological order and lists are closed, so the mesh is valid after each entry. The budget can stop a
/// walk after any entry, and the next walk can go in either direction.
///
///   list of a region   |#########|...........|     #: applied entries
///                      0      cursor      length   cursor = length: the mesh has full resolution in the cell
///
/// The forest first refines the target regions, in their order, and then coarsens the others. A record in the lists of
/// a refined and of a coarsened region therefore stays split. A region that is no longer in the target can be retained:
/// it stays refined until its tree nodes are needed or the loader retires it. The paper collapses first and splits
/// afterwards, to free memory. In this forest each face has its own row, so only tree nodes can run out. If they do,
/// all retained regions are coarsened.
///
/// Realtime after construction, except for the functions marked otherwise. One thread at a time.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (vertex forest, two-phase local refinement).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/cache.hpp"
#include "spm/region_grid.hpp"

namespace tactus::spm {

/// The work that calls of `advance` may still do.
struct Budget {
  std::uint32_t units = 0;
  static constexpr std::uint32_t kVisit = 1;    ///< units of one list entry
  static constexpr std::uint32_t kChange = 16;  ///< units of one split, collapse or base face, including its refit
};

/// Counts since construction.
struct ForestCounters {
  std::uint64_t splits = 0;
  std::uint64_t collapses = 0;
  std::uint64_t visits = 0;  ///< list entries
};

enum class Advance : std::uint8_t {
  kDone,          ///< the target is reached
  kBudget,        ///< the budget is used up
  kPreviousFull,  ///< no more changed leaf nodes can be stored, see AbTree::store_previous
  kNodesFull      ///< too few tree nodes are free for the next split, so some target regions stay coarse
};

/// The treatment of loaded regions that are not in the target.
enum class Unrequested : std::uint8_t {
  kCoarsen,
  kRetain  ///< stay refined until they are retired or more than Forest::retained_node_limit nodes are used
};

class Forest {
 public:
  /// `pool` and `nodes` must outlive the forest. Not realtime: allocates.
  Forest(Pool& pool, NodePool& nodes, ObjectIndex object, const ModelSummary& summary, RegionGrid grid, BaseSlots base);

  /// Returns the bytes that the forest needs for the base mesh of an object, and the state of the regions that can be
  /// loaded at a time.
  [[nodiscard]] static std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool) noexcept {
    constexpr std::uint64_t kPerLoaded = sizeof(State) + 3 * sizeof(StateIndex);
    const std::uint32_t loaded = max_loaded(summary.regions, pool);
    return std::uint64_t{summary.base_faces} * sizeof(BaseSlots::Face) + loaded * kPerLoaded +
           CompactIndex::bytes(loaded);
  }

  /// Returns the number of used nodes above which the forest coarsens retained regions, the oldest first. It is half of
  /// the leaf nodes that the faces of all slots fill, and at most half of all nodes. The other half stays free for the
  /// next contacts.
  [[nodiscard]] static std::uint32_t retained_node_limit(const PoolSettings& pool) noexcept {
    return std::min(pool.slots / 8, pool.tree_nodes / 2);
  }

  /// Adds a page, which must outlive the forest. RegionGrid::can_insert must be true for the grid.
  void add(const RegionPage& page) noexcept { grid_.insert(page); }
  /// Removes a page. Queries that meet it are no longer exact. Loaded regions in it stay loaded.
  void remove(const RegionPage& page) noexcept { grid_.remove(page); }
  /// Adds a loaded region. It stays coarse until it is in a target.
  void add(RegionId region, RegionList list) noexcept;
  /// Starts to unload a region: `advance` coarsens it, then `take_retired` returns it.
  void retire(RegionId region) noexcept;
  /// Removes a retired region without applied records and returns it, so that the loader can free it. Returns kNone if
  /// there is no such region.
  [[nodiscard]] RegionId take_retired() noexcept;

  /// Sets the regions to refine, the most urgent first, and the treatment of all others. Skips regions that are not
  /// loaded. O(count).
  void set_targets(const RegionId* regions, std::uint32_t count,
                   Unrequested other_regions = Unrequested::kCoarsen) noexcept;

  /// A region of which a part of the list, or all of it, is applied.
  struct Applied {
    RegionId region{};
    std::uint32_t entries = 0;  ///< number of applied list entries, from the beginning of the list
  };
  /// Sets the exact number of applied entries of each region; the others become coarse. Then this forest shows the same
  /// mesh as the one whose regions they are (`copy_in_use`). Skips regions that are not loaded. O(count).
  void set_targets(const Applied* regions, std::uint32_t count) noexcept;

  /// Refines and coarsens towards the target, as far as `budget` allows, and subtracts the work from `budget`. `refit`
  /// must be called before the next query.
  [[nodiscard]] Advance advance(Budget& budget) noexcept;
  /// See AbTree::store_previous.
  void store_previous(bool enabled) noexcept { tree_.store_previous(enabled); }
  [[nodiscard]] bool previous_differs() const noexcept { return tree_.previous_differs(); }
  /// See AbTree::refit.
  RefitCount refit(ChangeDetector* change_detectors = nullptr, std::uint32_t count = 0) noexcept {
    return tree_.refit(change_detectors, count);
  }

  /// Starts to remove a withdrawn object: from now on `advance` only collapses records and then hides the base mesh. Do
  /// not add or retire regions afterwards.
  void withdraw() noexcept { withdrawn_ = true; }
  /// True if `withdraw` was called, no face is shown, and no tree node or retired region is in use.
  [[nodiscard]] bool is_fully_hidden() const noexcept {
    return withdrawn_ && base_cursor_ == 0 && in_use_count_ == 0 && oldest_ == kNone && tree_.root() == kNone;
  }

  [[nodiscard]] bool is_base_shown() const noexcept { return base_cursor_ == base_.faces.size(); }
  [[nodiscard]] bool is_refined(RegionId region) const noexcept {
    const StateIndex at = find(region);
    return at != kNone && states_[at].cursor == states_[at].list.length;
  }
  [[nodiscard]] bool is_loaded(RegionId region) const noexcept { return find(region) != kNone; }
  [[nodiscard]] bool is_retiring(RegionId region) const noexcept {
    const StateIndex at = find(region);
    return at != kNone && states_[at].retiring;
  }
  /// State of a region that has applied list entries, is in the target or is being retired.
  struct InUse {
    RegionId region{};
    std::uint32_t applied = 0;  ///< number of applied list entries
    bool retiring = false;
    bool retained = false;
  };
  /// Copies the state that one cycle passes to the next, without the list of loaded regions. The regions in use come
  /// first, in the order of `in_use_`, then the retained regions, the oldest first. Copies at most `capacity` entries.
  /// Returns the number of all entries, or a number above `capacity` if they do not fit. With capacity 0, returns the
  /// number of all. O(regions in use + min(retained regions, capacity)).
  [[nodiscard]] std::uint32_t copy_in_use(InUse* out, std::uint32_t capacity) const noexcept;
  [[nodiscard]] std::uint32_t base_faces_shown() const noexcept { return static_cast<std::uint32_t>(base_cursor_); }
  /// Restores, to the bit, a state that `copy_in_use` of another forest with the same model and settings returned. This
  /// forest must have the same loaded regions and must not have shown a face yet. False if the state is impossible or
  /// does not fit; the forest is then unusable. Not realtime: O(shown records).
  [[nodiscard]] bool restore(std::uint32_t base_faces, const InUse* regions, std::uint32_t count) noexcept;

  /// True if the base mesh is shown, the grid has every page that the sphere meets, and every labelled cell that the
  /// sphere intersects is refined. A query within the sphere then returns the contacts of the finest mesh. False if a
  /// coordinate is not finite.
  [[nodiscard]] bool is_exact(const Vec3d& centre, double radius) const noexcept;

  [[nodiscard]] const AbTree& tree() const noexcept { return tree_; }
  [[nodiscard]] const BaseSlots& base() const noexcept { return base_; }
  /// Leaf and lane in `tree()` that show the face.
  [[nodiscard]] LeafLane shown_at(RowIndex row) const noexcept { return pool_.shown_at[row]; }
  struct ShownFace {
    std::array<Slot, 3> corners{};
    bool is_finest = false;
  };
  /// Returns the faces that the shown records imply, without reading the tree. O(pool), allocates: tests.
  [[nodiscard]] std::map<RowIndex, ShownFace> shown_faces() const;
  [[nodiscard]] const RegionGrid& grid() const noexcept { return grid_; }
  [[nodiscard]] const ForestCounters& counters() const noexcept { return counters_; }
  /// The mesh hash: the xor of the hashes of all shown records. The set of shown records determines every corner of
  /// every face. O(1), because each split and collapse updates the hash.
  [[nodiscard]] std::uint64_t mesh_hash() const noexcept { return hash_; }
  [[nodiscard]] static std::uint64_t hash_of(VertexId vertex) noexcept;

  /// Recounts the applied list entries of each record, compares the shown faces with the records, and checks the tree.
  /// O(pool), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;

 private:
  /// An entry of `states_`.
  enum class StateIndex : std::uint32_t {};
  /// The state of a loaded region.
  struct State {
    RegionId region = kNone;  // kNone: the entry is free
    RegionList list;
    std::uint32_t cursor = 0;                 // number of applied entries
    BlockIndex block = kNone;                 // the block that `entry` used last
    std::uint32_t block_number = 0;           // its number in the list
    std::uint32_t target_number = 0;          // number of the last target with this region
    std::uint32_t target_entries = 0;         // number of entries to apply in that target
    std::uint32_t in_use_at = kNone;          // index in in_use_
    StateIndex older = kNone, newer = kNone;  // neighbours in the list of retained regions
    bool retiring = false;
    bool retained = false;
  };

  /// Each loaded region needs at least one list block.
  [[nodiscard]] static std::uint32_t max_loaded(std::uint32_t regions, const PoolSettings& pool) noexcept {
    return regions < pool.list_blocks ? regions : pool.list_blocks;
  }
  [[nodiscard]] auto key_of_state() const noexcept {
    return [this](std::uint32_t number) { return std::uint64_t{index(states_[StateIndex{number}].region)}; };
  }
  /// The state of a loaded region, or kNone.
  [[nodiscard]] StateIndex find(RegionId region) const noexcept {
    return StateIndex{state_index_.find(index(region), key_of_state())};
  }
  [[nodiscard]] bool is_target(const State& state) const noexcept {
    return state.target_number == target_number_ && !state.retiring;
  }
  void add_in_use(StateIndex at) noexcept;
  void remove_in_use(StateIndex at) noexcept;
  void begin_target(Unrequested other_regions) noexcept;
  void add_target(RegionId region, std::uint32_t entries) noexcept;
  void retain(StateIndex at) noexcept;
  void end_retention(StateIndex at) noexcept;
  [[nodiscard]] Advance refine(State& state, Budget& budget) noexcept;
  [[nodiscard]] Advance coarsen(State& state, Budget& budget, std::uint32_t& entries) noexcept;
  [[nodiscard]] Advance hide_all(Budget& budget) noexcept;
  [[nodiscard]] std::uint32_t entries_to_coarsen() const noexcept;
  [[nodiscard]] const PackedSlot* entry(State& state, std::uint32_t number) noexcept;
  [[nodiscard]] bool has_tree_nodes_for(Slot slot) const noexcept;
  [[nodiscard]] bool has_previous_nodes_for(Slot slot) const noexcept;
  void show_base_face(const BaseSlots::Face& face) noexcept;
  void split(Slot slot) noexcept;
  void collapse(Slot slot) noexcept;
  void prefetch_records(const PackedSlot* slots, std::uint32_t count, bool splitting) const noexcept;

  Pool& pool_;
  NodePool& nodes_;
  RegionGrid grid_;
  AbTree tree_;
  BaseSlots base_;
  std::size_t base_cursor_ = 0;
  IdVector<StateIndex, State> states_;
  CompactIndex state_index_;  // loaded region -> its state
  std::vector<StateIndex> free_states_;
  std::vector<StateIndex> in_use_;  // regions in the target, retiring, or not coarse yet; fixed capacity
  std::uint32_t in_use_count_ = 0;
  StateIndex oldest_ = kNone, newest_ = kNone;  // retained regions: a cursor above 0, not in use
  Unrequested unrequested_ = Unrequested::kCoarsen;
  std::uint32_t entries_to_coarsen_ = 0;  // entries of retained regions to coarsen for this target
  std::vector<StateIndex> targets_;       // target regions, in order; one may have been unloaded since
  std::uint32_t target_count_ = 0;
  std::uint32_t retiring_count_ = 0;
  bool withdrawn_ = false;
  std::uint32_t target_number_ = 0;
  std::uint64_t hash_ = 0;
  ForestCounters counters_;
};

}  // namespace tactus::spm
