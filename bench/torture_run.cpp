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
constexpr std::uint32_t kMaxWanted = 12;  // regions of one target
constexpr double kMinBudget = 1, kMaxBudget = 3e5;

/// Regions here and there share few tree nodes: a node for two slots, where an HRTC has one for three.
spm::PoolSettings pool_for(const spm::ModelSummary& summary, double share) {
  spm::PoolSettings settings = spm::PoolSettings::for_slots(slots_for(summary, share));
  settings.tree_nodes = settings.slots / 2 + 1024;
  return settings;
}

/// A shown face in ids: what does not depend on where things lie in memory.
struct ShownFace {
  std::uint32_t face, last;
  std::array<std::uint32_t, 3> vertices;
  std::array<float, 9> corners;
  [[nodiscard]] bool operator==(const ShownFace& other) const noexcept {
    return face == other.face && last == other.last && vertices == other.vertices && corners == other.corners;
  }
};

std::vector<ShownFace> shown_mesh(const HrtcModel& hrtc) {
  std::vector<ShownFace> faces;
  for (const spm::RowIndex number : hrtc.forest().tree().shown()) {
    const spm::FaceRow& row = hrtc.pool().faces[number];
    ShownFace face{index(row.face), row.last, {}, hrtc.forest().tree().corners(number)};
    for (std::size_t corner = 0; corner < 3; ++corner)
      face.vertices[corner] = index(hrtc.pool().vertices[row.vertices[corner]].id);
    faces.push_back(face);
  }
  return faces;
}

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
      while (count().operations() < until) step();
      result_.seconds += watch.lap() * 1e-6;
      recount();
    }
    finish();
    return count();
  }

 private:
  std::uint64_t any(std::uint64_t below) { return random_() % below; }
  RegionId any_region() { return RegionId{static_cast<std::uint32_t>(any(regions_))}; }
  /// Evenly over the magnitudes, so that cuts fall everywhere.
  std::uint32_t any_budget() {
    const double unit = static_cast<double>(random_() >> 11) * 0x1p-53;
    return static_cast<std::uint32_t>(kMinBudget * std::pow(kMaxBudget / kMinBudget, unit));
  }

  TortureResult& count() {
    const spm::ForestCounters& forest = hrtc_.forest().counters();
    const spm::CacheCounters& cache = hrtc_.cache().counters();
    result_.splits = forest.splits;
    result_.collapses = forest.collapses;
    result_.loaded = std::min<std::uint64_t>(cache.records_accepted, records_);
    result_.reloaded = cache.records_accepted - result_.loaded;  // at least
    result_.repeated = cache.records_repeated;
    result_.regions_evicted = cache.regions_released;
    return result_;
  }

  void step() {
    ++result_.steps;
    switch (any(8)) {
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
        for (std::uint64_t more = any(kMaxWanted + 1); more > 0; --more) wanted_.push_back(any_region());
        hrtc_.forest().target(wanted_.data(), static_cast<std::uint32_t>(wanted_.size()),
                              any(2) == 0 ? spm::Unrequested::kCoarsen : spm::Unrequested::kRest);
        break;
      }
      default:
        break;
    }
    spm::Budget budget{any_budget()};
    if (hrtc_.forest().advance(budget) == spm::Advance::kBudget) ++result_.cut_by_budget;
    if (any(4) > 0) hrtc_.forest().refit();  // several steps may share a refit
    if (any(2) > 0) release();
  }

  void load() {
    const RegionId region = any_region();
    if (hrtc_.cache().holds(hrtc_.object(), region)) return;
    const spm::AcceptResult accepted = hrtc_.load(hrtc_.message(region, any(4) == 0));
    if (accepted == spm::AcceptResult::kAccepted) {
      ++result_.regions_loaded;
    } else if (accepted == spm::AcceptResult::kPoolFull) {
      ++result_.refused_full;
      retire();
      retire();
    } else {
      problem("region " + std::to_string(index(region)) +
              " was refused: " + std::to_string(static_cast<int>(accepted)));
    }
  }

  /// A held region from a random place on.
  void retire() {
    const std::uint32_t from = index(any_region());
    for (std::uint32_t i = 0; i < regions_; ++i) {
      const RegionId region{(from + i) % regions_};
      if (!hrtc_.forest().is_here(region) || hrtc_.forest().is_retiring(region)) continue;
      hrtc_.forest().retire(region);
      return;
    }
  }

  void release() {
    const std::uint32_t before = hrtc_.records_held();
    (void)hrtc_.release_retired();
    result_.evicted += before - hrtc_.records_held();
  }

  void problem(std::string text) {
    if (result_.problems.size() < kMaxProblems) result_.problems.push_back(std::move(text));
  }

  void recount() {
    ++result_.checks;
    hrtc_.forest().refit();
    for (std::string& text : hrtc_.forest().violations()) problem(std::move(text));
    for (std::string& text : hrtc_.cache().violations()) problem(std::move(text));
  }

  void finish() {
    const spm::Model& model = hrtc_.model();
    for (std::uint32_t more = 0; more < kMaxWanted || hrtc_.records_held() == 0; ++more) {
      load();
      refine(hrtc_, {});
      release();
    }
    std::vector<RegionId> goal;
    for (std::uint32_t region = 0; region < model.summary.regions; ++region)
      if (hrtc_.forest().is_here(RegionId{region}) && !hrtc_.forest().is_retiring(RegionId{region}) &&
          (goal.empty() || any(3) > 0))
        goal.push_back(RegionId{region});
    std::shuffle(goal.begin(), goal.end(), random_);
    result_.regions_at_end = static_cast<std::uint32_t>(goal.size());
    refine(hrtc_, goal);
    release();
    recount();
    result_.hash = hrtc_.forest().mesh_hash();

    std::vector<bool> wanted(model.summary.records, false);
    for (const RegionId region : goal)
      for (const spm::Interval& run : model.intervals_of(region))
        std::fill(wanted.begin() + run.first, wanted.begin() + run.first + run.count, true);
    for (std::uint32_t record = 0; record < model.summary.records; ++record)
      if (wanted[record]) result_.expected_hash ^= spm::Forest::hash_of(model.vertex_of(spm::RecordId{record}));

    HrtcModel fresh{model, pool_for(model.summary, 1)};
    std::sort(goal.begin(), goal.end());
    for (const RegionId region : goal)
      if (fresh.load(fresh.message(region, true)) != spm::AcceptResult::kAccepted)
        problem("the fresh forest refused region " + std::to_string(index(region)));
    refine(fresh, goal);
    result_.fresh_hash = fresh.forest().mesh_hash();
    compare(shown_mesh(hrtc_), shown_mesh(fresh));
  }

  void refine(HrtcModel& hrtc, const std::vector<RegionId>& goal) {
    hrtc.forest().target(goal.data(), static_cast<std::uint32_t>(goal.size()));
    // What coarsens frees its tree nodes in the refit; what found none before then finds them.
    constexpr int kMaxRounds = 8;
    spm::Advance advance = spm::Advance::kBudget;
    for (int round = 0; round < kMaxRounds && advance != spm::Advance::kDone; ++round) {
      spm::Budget budget{~0u};
      advance = hrtc.forest().advance(budget);
      hrtc.forest().refit();
    }
    if (advance != spm::Advance::kDone) problem("a set of regions was not refined to its end");
  }

  void compare(const std::vector<ShownFace>& ours, const std::vector<ShownFace>& theirs) {
    result_.faces_compared = theirs.size();
    const std::size_t common = std::min(ours.size(), theirs.size());
    result_.faces_different = std::max(ours.size(), theirs.size()) - common;
    for (std::size_t i = 0; i < common; ++i) result_.faces_different += ours[i] == theirs[i] ? 0 : 1;
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
