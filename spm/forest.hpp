/// The haptic thread's half of an object: which records are shown (the refined front), and how that follows the
/// contact.
///
/// A region is refined by walking its list forwards (each record wanted once more, split unless shown) and coarsened by
/// walking it backwards (wanted once less, collapsed when wanted no more). Ids ascend topologically and lists are
/// closed, so wherever a walk stops the mesh is valid: the budget may cut anywhere, a region may turn round half way.
/// Records that two regions share are split once and stay.
///
///   region   |#########|...........|     #: applied prefix; the mesh is exact in the cell when nothing is left
///            0      cursor      length
///
/// Refining goes first, in the order asked for, and coarsening after it, so that what old and new regions share never
/// moves. A region that is no longer asked for may *rest*, refined as far as it is, until its tree nodes are needed or
/// it is retired: a tip that comes back finds it as it was left. We differ from the paper's order (collapse, then
/// split) because faces have their own rows: there is no pool to free first; only tree nodes are taken, and when these
/// run out coarsening goes first. Realtime after construction, but for the functions marked otherwise. One thread at a
/// time. Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (vertex forest, two-phase local refinement).
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/cache.hpp"
#include "spm/region_grid.hpp"

namespace tactus::spm {

/// What one call may still do. Entries of lists visited, records split or collapsed and base faces shown all cost.
struct Budget {
  std::uint32_t units = 0;
  static constexpr std::uint32_t kVisit = 1;    ///< one list entry
  static constexpr std::uint32_t kChange = 16;  ///< one split or collapse, its share of the refit included
};

/// Counts since the start; differences give a cycle's.
struct ForestCounters {
  std::uint64_t splits = 0;
  std::uint64_t collapses = 0;
  std::uint64_t visits = 0;
};

enum class Advance : std::uint8_t {
  kDone,      ///< everything stands as asked
  kBudget,    ///< stopped by the budget
  kKeptFull,  ///< stopped for want of room to keep what changes; see AbTree::keep
  kNodesFull  ///< no tree node left: some regions stay coarse
};

/// What becomes of regions that are not asked for.
enum class Unrequested : std::uint8_t {
  kCoarsen,
  kRest  ///< until they are retired, or more nodes are in use than Forest::max_resting
};

class Forest {
 public:
  /// `grid` is copied; `pool` and `nodes` must outlive the forest. Not realtime: allocates.
  Forest(Pool& pool, NodePool& nodes, std::uint32_t object, const ModelSummary& summary, RegionGrid grid,
         BaseSlots base);

  /// What an object's regions take here, whatever of them is held.
  [[nodiscard]] static std::uint64_t directory_bytes(const ModelSummary& summary, const PoolSettings& pool) noexcept {
    constexpr std::uint64_t kPerHeld = sizeof(State) + 2 * sizeof(RegionId) + sizeof(std::uint32_t);
    return RegionGrid::bytes(summary.regions) + std::uint64_t{summary.regions} * sizeof(std::uint32_t) +
           std::uint64_t{max_held(summary.regions, pool)} * kPerHeld;
  }

  /// Nodes in use beyond which regions that rest are coarsened, the one longest unasked for first: half of what the
  /// slots can show. The other half is for what is met next, and what a loader gives back first is coarse by then.
  [[nodiscard]] static std::uint32_t max_resting(const PoolSettings& pool) noexcept {
    return std::min(pool.slots / 8, pool.tree_nodes / 2);
  }

  /// A region has been loaded. It stays coarse until asked for.
  void add(RegionId region, RegionList list) noexcept;
  /// It is to be unloaded: coarsened as the budget allows, then reported by `take_retired`.
  void retire(RegionId region) noexcept;
  /// A retired region of which nothing is applied any more, or kNone. The loader may free it.
  [[nodiscard]] std::uint32_t take_retired() noexcept;

  /// Says which regions shall be refined, first comes first, and what is to become of all others. Regions that are not
  /// here are passed over. O(regions asked for).
  void target(const RegionId* regions, std::uint32_t count, Unrequested unrequested = Unrequested::kCoarsen) noexcept;

  /// Works towards the target. Then refit before any query.
  [[nodiscard]] Advance advance(Budget& budget) noexcept;
  /// See AbTree::keep.
  void keep(bool keeping) noexcept { tree_.keep(keeping); }
  [[nodiscard]] bool kept_differs() const noexcept { return tree_.kept_differs(); }
  /// See AbTree::refit.
  RefitCount refit(ChangeDetector* change_detectors = nullptr, std::uint32_t count = 0) noexcept {
    return tree_.refit(change_detectors, count);
  }

  [[nodiscard]] bool base_shown() const noexcept { return base_cursor_ == base_.faces.size(); }
  [[nodiscard]] bool is_refined(RegionId region) const noexcept {
    if (!is_here(region)) return false;
    const State& state = state_of(region);
    return state.cursor == state.list.length;
  }
  [[nodiscard]] bool is_here(RegionId region) const noexcept { return place_[index(region)] != kNone; }
  [[nodiscard]] bool is_retiring(RegionId region) const noexcept {
    return is_here(region) && state_of(region).retiring;
  }
  /// What one cycle leaves to the next, beside the regions that are here: those that were worked on. First those in
  /// use, from the last of which on they are coarsened or laid to rest, then those that rest, the oldest first. Copies
  /// at most `capacity`; returns how many there are. O(regions in use and resting).
  struct InUse {
    RegionId region{};
    std::uint32_t applied = 0;  ///< entries of its list
    bool retiring = false;
    bool resting = false;
  };
  [[nodiscard]] std::uint32_t in_use(InUse* out, std::uint32_t capacity) const noexcept;
  [[nodiscard]] std::uint32_t base_faces_shown() const noexcept { return static_cast<std::uint32_t>(base_cursor_); }
  /// Makes a forest in which nothing has been shown yet what another one of the same model and settings was when it
  /// told these, to the bit. The regions that were here must be. False when these cannot have been told or find no
  /// room: then it is of no more use. Not realtime: O(all that is shown).
  [[nodiscard]] bool restore(std::uint32_t base_faces, const InUse* regions, std::uint32_t count) noexcept;

  /// A query of that sphere is exact: every labelled cell it meets is refined. False when a coordinate is not finite.
  [[nodiscard]] bool exact(const Vec3d& centre, double radius) const noexcept;

  [[nodiscard]] const AbTree& tree() const noexcept { return tree_; }
  [[nodiscard]] const RegionGrid& grid() const noexcept { return grid_; }
  [[nodiscard]] const ForestCounters& counters() const noexcept { return counters_; }
  /// Names the shown mesh: xor over the shown records of a mixed id. O(1) kept up to date. A function of the set of
  /// shown records alone, and these determine every corner of every face.
  [[nodiscard]] std::uint64_t mesh_hash() const noexcept { return hash_; }
  [[nodiscard]] static std::uint64_t hash_of(std::uint32_t vertex_id) noexcept;

  /// What is broken: counters against a recount, shown faces against the records, the tree. O(pool), allocates.
  [[nodiscard]] std::vector<std::string> violations() const;

 private:
  struct State {
    RegionList list;
    std::uint32_t cursor = 0;     // entries applied
    std::uint32_t block = kNone;  // the block last used, and its place in the list
    std::uint32_t block_number = 0;
    std::uint32_t requested = 0;                 // stamp of the target that asked for it
    std::uint32_t in_use_at = kNone;             // place in in_use_
    std::uint32_t older = kNone, newer = kNone;  // of those that rest, its neighbours
    bool retiring = false;
    bool resting = false;
  };

  /// Each region that is here takes a list block at least.
  [[nodiscard]] static std::uint32_t max_held(std::uint32_t regions, const PoolSettings& pool) noexcept {
    return regions < pool.list_blocks ? regions : pool.list_blocks;
  }
  [[nodiscard]] State& state_of(RegionId region) noexcept { return states_[place_[index(region)]]; }
  [[nodiscard]] const State& state_of(RegionId region) const noexcept { return states_[place_[index(region)]]; }
  [[nodiscard]] bool wants(const State& state) const noexcept { return state.requested == stamp_ && !state.retiring; }
  void use(RegionId region) noexcept;
  void unuse(RegionId region) noexcept;
  void rest(RegionId region) noexcept;
  void wake(RegionId region) noexcept;
  [[nodiscard]] Advance refine(State& state, Budget& budget) noexcept;
  [[nodiscard]] Advance coarsen(State& state, Budget& budget, std::uint32_t& entries) noexcept;
  [[nodiscard]] std::uint32_t overdue() const noexcept;
  [[nodiscard]] const std::uint32_t* entry(State& state, std::uint32_t number) noexcept;
  [[nodiscard]] bool room_for(std::uint32_t slot) const noexcept;
  [[nodiscard]] bool room_to_keep(std::uint32_t slot) const noexcept;
  void split(std::uint32_t slot) noexcept;
  void collapse(std::uint32_t slot) noexcept;
  void fetch(const std::uint32_t* slots, std::uint32_t count, bool splitting) const noexcept;

  Pool& pool_;
  NodePool& nodes_;
  RegionGrid grid_;
  AbTree tree_;
  BaseSlots base_;
  std::size_t base_cursor_ = 0;
  std::vector<std::uint32_t> place_;  // by region: in states_, kNone when it is not here
  std::vector<State> states_;         // of regions that are here
  std::vector<std::uint32_t> free_states_;
  std::vector<RegionId> in_use_;  // asked for, retiring, or left with a cursor above 0 since; fixed capacity
  std::uint32_t in_use_count_ = 0;
  std::uint32_t oldest_ = kNone, newest_ = kNone;  // of the regions that rest: a cursor above 0, and not in use
  Unrequested unrequested_ = Unrequested::kCoarsen;
  std::uint32_t overdue_ = 0;    // entries of what rests that are to be taken back for this target
  std::vector<RegionId> order_;  // regions asked for, in order
  std::uint32_t order_count_ = 0;
  std::uint32_t retiring_count_ = 0;
  std::uint32_t stamp_ = 0;
  std::uint64_t hash_ = 0;
  ForestCounters counters_;
};

}  // namespace tactus::spm
