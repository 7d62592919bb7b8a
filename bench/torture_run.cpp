#include "bench/torture_run.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "bench/hrtc_model.hpp"
#include "bench/stopwatch.hpp"

namespace tactus::bench {
namespace {

using spm::RegionId;

constexpr std::size_t kMaxProblems = 10;
constexpr std::uint32_t kMaxWanted = 12;  // regions in a target
constexpr double kMinBudget = 1, kMaxBudget = 3e5;

/// Returns settings with one tree node per two slots. An HRTC has fewer, but random regions need more, because
/// they share fewer tree nodes than regions around a probe.
spm::PoolSettings pool_for(const spm::ModelSummary& summary, double share) {
  spm::PoolSettings settings = spm::PoolSettings::for_slots(slots_for(summary, share));
  settings.tree_nodes = settings.slots / 2 + 1024;
  return settings;
}

/// A shown face, described by ids, so that faces of two forests can be compared although their rows differ.
struct ShownFace {
  std::uint32_t face;
  bool finest;
  std::array<std::uint32_t, 3> vertices;
  std::array<float, 9> corners;
  [[nodiscard]] bool operator==(const ShownFace& other) const noexcept {
    return face == other.face && finest == other.finest && vertices == other.vertices && corners == other.corners;
  }
};

std::vector<ShownFace> shown_mesh(const HrtcModel& hrtc) {
  std::vector<ShownFace> faces;
  const spm::AbTree& tree = hrtc.forest().tree();
  for (const auto& [row, shown] : hrtc.forest().shown_faces()) {
    const spm::LeafLane at = hrtc.forest().shown_at(row);
    ShownFace face{index(tree.face(at)), tree.is_finest(at), {}, tree.corners(at)};
    for (std::size_t corner = 0; corner < 3; ++corner)
      face.vertices[corner] = index(hrtc.pool().vertices[shown.corners[corner]].id);
    faces.push_back(face);
  }
  std::sort(faces.begin(), faces.end(), [](const ShownFace& a, const ShownFace& b) { return a.face < b.face; });
  return faces;
}

/// Runs the random operations on an HRTC's cache and forest, and checks them.
class Torture {
 public:
  Torture(const spm::Model& model, const TortureSettings& settings)
      : settings_{settings},
        hrtc_{model, pool_for(model.summary, settings.pool_share)},
        random_{settings.seed},
        regions_{model.summary.regions},
        records_{model.summary.records} {}

  TortureResult run() {
    Stopwatch watch;
    for (std::uint32_t check = 1; check <= settings_.checks; ++check) {
      watch.lap();
      const std::uint64_t until = settings_.operations * check / settings_.checks;
      while (update_counts().operations() < until) step();
      result_.seconds += watch.lap() * 1e-6;
      check_invariants();
    }
    check_final_mesh();
    return update_counts();
  }

 private:
  std::uint64_t random_below(std::uint64_t bound) { return random_() % bound; }
  RegionId random_region() { return RegionId{static_cast<std::uint32_t>(random_below(regions_))}; }
  /// Returns a random budget. Its logarithm is uniform, so that some steps end after a few records, others after many.
  std::uint32_t random_budget() {
    const double unit = static_cast<double>(random_() >> 11) * 0x1p-53;
    return static_cast<std::uint32_t>(kMinBudget * std::pow(kMaxBudget / kMinBudget, unit));
  }

  TortureResult& update_counts() {
    const spm::ForestCounters& forest = hrtc_.forest().counters();
    const spm::CacheCounters& cache = hrtc_.cache().counters();
    result_.splits = forest.splits;
    result_.collapses = forest.collapses;
    result_.loaded = std::min<std::uint64_t>(cache.records_accepted, records_);
    result_.reloaded = cache.records_accepted - result_.loaded;  // exact if all records were loaded, else a lower bound
    result_.repeated = cache.records_repeated;
    result_.regions_evicted = cache.regions_released;
    return result_;
  }

  void step() {
    ++result_.steps;
    switch (random_below(8)) {
      case 0:
      case 1:
        load();
        break;
      case 2:
        retire();
        break;
      case 3:
      case 4: {
        wanted_.clear();
        for (std::uint64_t remaining = random_below(kMaxWanted + 1); remaining > 0; --remaining)
          wanted_.push_back(random_region());
        hrtc_.forest().set_targets(wanted_.data(), static_cast<std::uint32_t>(wanted_.size()),
                                   random_below(2) == 0 ? spm::Unrequested::kCoarsen : spm::Unrequested::kRetain);
        break;
      }
      default:
        break;
    }
    spm::Budget budget{random_budget()};
    if (hrtc_.forest().advance(budget) == spm::Advance::kBudget) ++result_.cut_by_budget;
    if (random_below(4) > 0) hrtc_.forest().refit();  // several steps may share a refit
    if (random_below(2) > 0) release();
  }

  void load() {
    const RegionId region = random_region();
    if (hrtc_.cache().is_loaded(hrtc_.object(), region)) return;
    const spm::AcceptResult accepted = hrtc_.load(hrtc_.message(region, random_below(4) == 0));
    if (accepted == spm::AcceptResult::kAccepted) {
      ++result_.regions_loaded;
    } else if (accepted == spm::AcceptResult::kPoolFull) {
      ++result_.refused_full;
      retire();
      retire();
    } else {
      add_problem("region " + std::to_string(index(region)) + " was refused with AcceptResult " +
                  std::to_string(static_cast<int>(accepted)));
    }
  }

  /// Starts at a random region number and retires the first loaded region found.
  void retire() {
    const std::uint32_t from = index(random_region());
    for (std::uint32_t i = 0; i < regions_; ++i) {
      const RegionId region{(from + i) % regions_};
      if (!hrtc_.forest().is_loaded(region) || hrtc_.forest().is_retiring(region)) continue;
      hrtc_.forest().retire(region);
      return;
    }
  }

  void release() {
    const std::uint32_t before = hrtc_.records_held();
    (void)hrtc_.release_retired();
    result_.evicted += before - hrtc_.records_held();
  }

  void add_problem(std::string text) {
    if (result_.problems.size() < kMaxProblems) result_.problems.push_back(std::move(text));
  }

  void check_invariants() {
    ++result_.checks;
    hrtc_.forest().refit();
    for (std::string& text : hrtc_.forest().violations()) add_problem(std::move(text));
    for (std::string& text : hrtc_.cache().violations()) add_problem(std::move(text));
  }

  /// Refines a random part of the loaded regions, and compares the mesh with that of a new forest with these regions.
  void check_final_mesh() {
    const spm::Model& model = hrtc_.model();
    for (std::uint32_t loads = 0; loads < kMaxWanted || hrtc_.records_held() == 0; ++loads) {
      load();
      refine(hrtc_, {});
      release();
    }
    std::vector<RegionId> refined_regions;
    for (std::uint32_t region = 0; region < model.summary.regions; ++region)
      if (hrtc_.forest().is_loaded(RegionId{region}) && !hrtc_.forest().is_retiring(RegionId{region}) &&
          (refined_regions.empty() || random_below(3) > 0))
        refined_regions.push_back(RegionId{region});
    std::shuffle(refined_regions.begin(), refined_regions.end(), random_);
    result_.regions_at_end = static_cast<std::uint32_t>(refined_regions.size());
    refine(hrtc_, refined_regions);
    release();
    check_invariants();
    result_.hash = hrtc_.forest().mesh_hash();

    std::vector<bool> wanted(model.summary.records, false);
    for (const RegionId region : refined_regions)
      for (const spm::Interval& interval : model.intervals_of(region))
        std::fill(wanted.begin() + interval.first, wanted.begin() + interval.first + interval.count, true);
    for (std::uint32_t record = 0; record < model.summary.records; ++record)
      if (wanted[record]) result_.expected_hash ^= spm::Forest::hash_of(model.vertex_of(spm::RecordId{record}));

    HrtcModel fresh{model, pool_for(model.summary, 1)};
    std::sort(refined_regions.begin(), refined_regions.end());
    for (const RegionId region : refined_regions)
      if (fresh.load(fresh.message(region, true)) != spm::AcceptResult::kAccepted)
        add_problem("the new forest refused region " + std::to_string(index(region)));
    refine(fresh, refined_regions);
    result_.fresh_hash = fresh.forest().mesh_hash();
    compare(shown_mesh(hrtc_), shown_mesh(fresh));
  }

  void refine(HrtcModel& hrtc, const std::vector<RegionId>& refined_regions) {
    hrtc.forest().set_targets(refined_regions.data(), static_cast<std::uint32_t>(refined_regions.size()));
    // Coarsening frees tree nodes in the refit. Splits that found no free node can then follow in the next round.
    constexpr int kMaxRounds = 8;
    spm::Advance advance = spm::Advance::kBudget;
    for (int round = 0; round < kMaxRounds && advance != spm::Advance::kDone; ++round) {
      spm::Budget budget{~0u};
      advance = hrtc.forest().advance(budget);
      hrtc.forest().refit();
    }
    if (advance != spm::Advance::kDone) add_problem("a set of regions was not refined completely");
  }

  void compare(const std::vector<ShownFace>& found, const std::vector<ShownFace>& expected) {
    result_.faces_compared = expected.size();
    const std::size_t common = std::min(found.size(), expected.size());
    result_.faces_different = std::max(found.size(), expected.size()) - common;
    for (std::size_t i = 0; i < common; ++i) result_.faces_different += found[i] == expected[i] ? 0 : 1;
  }

  TortureSettings settings_;
  HrtcModel hrtc_;
  std::mt19937_64 random_;
  std::uint32_t regions_, records_;
  std::vector<RegionId> wanted_;
  TortureResult result_;
};

}  // namespace

TortureResult torture(const spm::Model& model, const TortureSettings& settings) {
  return Torture{model, settings}.run();
}

}  // namespace tactus::bench
