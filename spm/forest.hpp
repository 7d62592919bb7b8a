/// The vertex forest of one object in the haptic thread: which records are shown (the refined front). It refines and
/// coarsens regions as the contact moves.
///
/// To refine a region, the forest walks its list forwards: it counts each record as wanted once more and splits those
/// that are not shown. To coarsen a region, it walks the list backwards: it counts each record as wanted once less and
/// collapses those that no region wants. Records are in topological order and lists are closed, so the mesh is valid
/// after each entry. The budget can stop a walk anywhere, and the next walk can go in the other direction. A record in
/// the lists of two regions is split once.
///
///   region   |#########|...........|     #: applied entries; cursor = length: the mesh is exact in the cell
///            0      cursor      length
///
/// The forest refines first, in the given order, and coarsens afterwards, so records that old and new regions share do
/// not change. A region without request can be retained: it stays refined until its tree nodes are needed or it is
/// retired. The paper collapses first and splits afterwards, to free memory. Here every face has a row of its own, so
/// only tree nodes can run out; the forest then coarsens first.
///
/// Realtime after construction, except for the functions marked otherwise. One thread at a time.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (vertex forest, two-phase local refinement).
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/cache.hpp"
#include "spm/region_grid.hpp"

namespace tactus::spm {

/// The work that one call may still do. A visited list entry, a split, a collapse and a base face each cost units.
struct Budget {
  std::uint32_t units = 0;
  static constexpr std::uint32_t kVisit = 1;    ///< one list entry
  static constexpr std::uint32_t kChange = 16;  ///< one split or collapse, with its share of the refit
};

/// Counts since the start.
struct ForestCounters {
  std::uint64_t splits = 0;
  std::uint64_t collapses = 0;
  std::uint64_t visits = 0;
};

enum class Advance : std::uint8_t {
  kDone,      ///< the target is reached
  kBudget,    ///< stopped by the budget
  kKeptFull,  ///< no room to store more changed nodes; see AbTree::keep
  kNodesFull  ///< no tree node is free: some regions stay coarse
};

/// The treatment of regions that are not in the target.
enum class Unrequested : std::uint8_t {
  kCoarsen,
  kRest  ///< retain until they are retired, or more nodes are in use than Forest::max_resting
};

class Forest {
 public:
  /// `pool` and `nodes` must outlive the forest. Not realtime: allocates.
  Forest(Pool& pool, NodePool& nodes, ObjectIndex object, const ModelSummary& summary, RegionGrid grid, BaseSlots base);

  /// Bytes that the forest needs for an object's regions, loaded or not.
  [[nodiscard]] static std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool) noexcept {
    constexpr std::uint64_t kPerHeld = sizeof(State) + 2 * sizeof(RegionId) + sizeof(std::uint32_t);
    return RegionGrid::bytes(summary.regions) + std::uint64_t{summary.regions} * sizeof(std::uint32_t) +
           std::uint64_t{max_held(summary.regions, pool)} * kPerHeld;
  }

  /// If more nodes are in use, retained regions are coarsened, the oldest first. Half of the nodes that the slots can
  /// show: the other half is for the next contacts.
  [[nodiscard]] static std::uint32_t max_resting(const PoolSettings& pool) noexcept {
    return std::min(pool.slots / 8, pool.tree_nodes / 2);
  }

  /// Adds a loaded region. It stays coarse until it is in a target.
  void add(RegionId region, RegionList list) noexcept;
  /// Starts to unload a region: `advance` coarsens it, then `take_retired` returns it.
  void retire(RegionId region) noexcept;
  /// Returns a retired region without applied records, which the loader may free, or kNone.
  [[nodiscard]] RegionId take_retired() noexcept;

  /// Sets the regions to refine, the most urgent first, and the treatment of all others. Skips regions that are not
  /// loaded. O(count).
  void target(const RegionId* regions, std::uint32_t count, Unrequested unrequested = Unrequested::kCoarsen) noexcept;

  /// Refines and coarsens towards the target. Call `refit` before the next query.
  [[nodiscard]] Advance advance(Budget& budget) noexcept;
  /// See AbTree::keep.
  void keep(bool keeping) noexcept { tree_.keep(keeping); }
  [[nodiscard]] bool kept_differs() const noexcept { return tree_.kept_differs(); }
  /// See AbTree::refit.
  RefitCount refit(ChangeDetector* change_detectors = nullptr, std::uint32_t count = 0) noexcept {
    return tree_.refit(change_detectors, count);
  }

  /// The object leaves: from now on `advance` only hides what is shown, the base mesh last. No region may be added or
  /// retired any more.
  void withdraw() noexcept { withdrawn_ = true; }
  /// It was withdrawn, and neither its records nor its tree nodes nor retired regions are in use any more.
  [[nodiscard]] bool is_gone() const noexcept {
    return withdrawn_ && base_cursor_ == 0 && in_use_count_ == 0 && oldest_ == kNone && tree_.root() == kNone;
  }

  [[nodiscard]] bool base_shown() const noexcept { return base_cursor_ == base_.faces.size(); }
  [[nodiscard]] bool is_refined(RegionId region) const noexcept {
    if (!is_here(region)) return false;
    const State& state = state_of(region);
    return state.cursor == state.list.length;
  }
  [[nodiscard]] bool is_here(RegionId region) const noexcept { return place_[region] != kNone; }
  [[nodiscard]] bool is_retiring(RegionId region) const noexcept {
    return is_here(region) && state_of(region).retiring;
  }
  /// The state that one cycle passes to the next, besides the loaded regions: first the regions in use, in the order of
  /// `in_use_`, then the retained ones, the oldest first. Copies at most `capacity` entries and returns how many there
  /// are. O(regions in use and retained).
  struct InUse {
    RegionId region{};
    std::uint32_t applied = 0;  ///< list entries
    bool retiring = false;
    bool resting = false;
  };
  [[nodiscard]] std::uint32_t in_use(InUse* out, std::uint32_t capacity) const noexcept;
  [[nodiscard]] std::uint32_t base_faces_shown() const noexcept { return static_cast<std::uint32_t>(base_cursor_); }
  /// Restores a state that another forest of the same model and settings reported by `in_use`, to the bit. This forest
  /// must have the same loaded regions and must not have shown a face yet. False if the state is impossible or does not
  /// fit; the forest is then unusable. Not realtime: O(shown records).
  [[nodiscard]] bool restore(std::uint32_t base_faces, const InUse* regions, std::uint32_t count) noexcept;

  /// True if every labelled cell that the sphere intersects is refined, so that a query of the sphere is exact. False
  /// if a coordinate is not finite.
  [[nodiscard]] bool exact(const Vec3d& centre, double radius) const noexcept;

  [[nodiscard]] const AbTree& tree() const noexcept { return tree_; }
  [[nodiscard]] const RegionGrid& grid() const noexcept { return grid_; }
  [[nodiscard]] const ForestCounters& counters() const noexcept { return counters_; }
  /// The mesh hash: xor of a hash of each shown record. O(1): updated with each change. It depends only on the set of
  /// shown records, which determines every corner of every face.
  [[nodiscard]] std::uint64_t mesh_hash() const noexcept { return hash_; }
  [[nodiscard]] static std::uint64_t hash_of(VertexId vertex) noexcept;

  /// Compares counters with a recount, shown faces with the records, and checks the tree. O(pool), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;

 private:
  struct State {
    RegionList list;
    std::uint32_t cursor = 0;  // entries applied
    BlockIndex block = kNone;  // the block used last, and its number in the list
    std::uint32_t block_number = 0;
    std::uint32_t requested = 0;            // stamp of the last target with this region
    std::uint32_t in_use_at = kNone;        // index in in_use_
    RegionId older = kNone, newer = kNone;  // neighbours in the list of retained regions
    bool retiring = false;
    bool resting = false;
  };

  /// Each loaded region needs at least one list block.
  [[nodiscard]] static std::uint32_t max_held(std::uint32_t regions, const PoolSettings& pool) noexcept {
    return regions < pool.list_blocks ? regions : pool.list_blocks;
  }
  [[nodiscard]] State& state_of(RegionId region) noexcept { return states_[place_[region]]; }
  [[nodiscard]] const State& state_of(RegionId region) const noexcept { return states_[place_[region]]; }
  [[nodiscard]] bool wants(const State& state) const noexcept { return state.requested == stamp_ && !state.retiring; }
  void use(RegionId region) noexcept;
  void unuse(RegionId region) noexcept;
  void rest(RegionId region) noexcept;
  void wake(RegionId region) noexcept;
  [[nodiscard]] Advance refine(State& state, Budget& budget) noexcept;
  [[nodiscard]] Advance coarsen(State& state, Budget& budget, std::uint32_t& entries) noexcept;
  [[nodiscard]] Advance hide_all(Budget& budget) noexcept;
  [[nodiscard]] std::uint32_t overdue() const noexcept;
  [[nodiscard]] const Slot* entry(State& state, std::uint32_t number) noexcept;
  [[nodiscard]] bool room_for(Slot slot) const noexcept;
  [[nodiscard]] bool room_to_keep(Slot slot) const noexcept;
  void split(Slot slot) noexcept;
  void collapse(Slot slot) noexcept;
  void fetch(const Slot* slots, std::uint32_t count, bool splitting) const noexcept;

  Pool& pool_;
  NodePool& nodes_;
  RegionGrid grid_;
  AbTree tree_;
  BaseSlots base_;
  std::size_t base_cursor_ = 0;
  IdVector<RegionId, std::uint32_t> place_;  // in states_; kNone if the region is not loaded
  std::vector<State> states_;                // of loaded regions
  std::vector<std::uint32_t> free_states_;
  std::vector<RegionId> in_use_;  // requested, retiring, or not coarse yet; fixed capacity
  std::uint32_t in_use_count_ = 0;
  RegionId oldest_ = kNone, newest_ = kNone;  // retained regions: a cursor above 0, not in use
  Unrequested unrequested_ = Unrequested::kCoarsen;
  std::uint32_t overdue_ = 0;    // entries of retained regions to coarsen for this target
  std::vector<RegionId> order_;  // requested regions, in order
  std::uint32_t order_count_ = 0;
  std::uint32_t retiring_count_ = 0;
  bool withdrawn_ = false;
  std::uint32_t stamp_ = 0;
  std::uint64_t hash_ = 0;
  ForestCounters counters_;
};

}  // namespace tactus::spm
