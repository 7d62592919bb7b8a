#include "spm/offline/region_lists.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <utility>

#include "spm/ids.hpp"
#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {
namespace {

/// Appends to `list` the collapses that the corners of these faces need, directly or indirectly. `seen`: by collapse,
/// the last cell whose list has it.
void append_closure(const TriangleMesh& mesh, std::span<const std::uint32_t> faces, const Dependencies& needs,
                    std::uint32_t cell, std::vector<std::uint32_t>& seen, std::vector<std::uint32_t>& list) {
  const auto append = [&](std::uint32_t collapse) {
    if (collapse == kNone || seen[collapse] == cell) return;
    seen[collapse] = cell;
    list.push_back(collapse);
  };
  std::size_t next = list.size();
  for (const std::uint32_t f : faces) {
    for (const std::uint32_t v : mesh.faces[f]) append(needs.removed_by[v]);
  }
  for (; next < list.size(); ++next) {
    for (const std::uint32_t need : needs.of(list[next])) append(need);
  }
}

/// Orders collapses that the same cells need (RegionLists::order). A collapse comes after its dependencies. Among the
/// collapses that may come next, the one whose anchor is nearest to the previous anchor comes first.
class NearestFirst {
 public:
  NearestFirst(const Dependencies& needs, const std::vector<std::uint32_t>& anchors)
      : needs_{needs}, anchors_{anchors} {}

  void order(std::span<std::uint32_t> same) {
    sorted_.assign(same.begin(), same.end());
    std::sort(sorted_.begin(), sorted_.end());
    missing_.assign(sorted_.size(), 0);
    dependants_.clear();
    ready_.clear();
    for (std::uint32_t i = 0; i < sorted_.size(); ++i) {
      for (const std::uint32_t need : needs_.of(sorted_[i])) {
        const auto found = std::lower_bound(sorted_.begin(), sorted_.end(), need);
        if (found == sorted_.end() || *found != need) continue;
        ++missing_[i];
        dependants_.push_back({static_cast<std::uint32_t>(found - sorted_.begin()), i});
      }
      if (missing_[i] == 0) ready_.push_back({anchors_[sorted_[i]], i});
    }
    std::sort(dependants_.begin(), dependants_.end());
    std::sort(ready_.begin(), ready_.end());
    for (std::uint32_t& next : same) {
      const std::uint32_t i = take_nearest();
      next = sorted_[i];
      for (auto w = std::lower_bound(dependants_.begin(), dependants_.end(), Pair{i, 0});
           w != dependants_.end() && w->first == i; ++w) {
        if (--missing_[w->second] > 0) continue;
        const Pair now_ready{anchors_[sorted_[w->second]], w->second};
        ready_.insert(std::lower_bound(ready_.begin(), ready_.end(), now_ready), now_ready);
      }
    }
  }

 private:
  using Pair = std::pair<std::uint32_t, std::uint32_t>;

  std::uint32_t take_nearest() {
    auto nearest = std::lower_bound(ready_.begin(), ready_.end(), Pair{last_anchor_, 0});
    if (nearest == ready_.end() ||
        (nearest != ready_.begin() && last_anchor_ - std::prev(nearest)->first < nearest->first - last_anchor_))
      --nearest;
    const std::uint32_t i = nearest->second;
    last_anchor_ = nearest->first;
    ready_.erase(nearest);
    return i;
  }

  const Dependencies& needs_;
  const std::vector<std::uint32_t>& anchors_;
  std::uint32_t last_anchor_ = 0;
  std::vector<std::uint32_t> sorted_;   // the collapses to order; the members below have indices in it
  std::vector<std::uint32_t> missing_;  // number of dependencies that are not placed yet
  std::vector<Pair> dependants_;        // dependency, dependant; ascending
  std::vector<Pair> ready_;             // anchor, collapse without missing dependencies; ascending
};

}  // namespace

RegionLists::RegionLists(const TriangleMesh& mesh, const Partition& cells, const Dependencies& needs, unsigned threads,
                         const std::function<void(double)>& progress)
    : cells_{cells.cells.size()}, groups_((cells_ + kGroup - 1) / kGroup) {
  std::vector<std::vector<std::uint32_t>> seen(thread_count(threads));  // by worker
  parallel_for(groups_.size(), threads, [&](std::size_t c, unsigned worker) {
    if (worker == 0) progress(double(c) / double(groups_.size()));
    if (seen[worker].empty()) seen[worker].assign(needs.size(), kNone);
    Group group;
    for (std::size_t i = c * kGroup; i < std::min(cells_, (c + 1) * kGroup); ++i) {
      const Cell& cell = cells.cells[i];
      append_closure(mesh, {cells.faces.data() + cell.first_face, cell.face_count}, needs,
                     static_cast<std::uint32_t>(i), seen[worker], group.collapses);
      group.ends.push_back(group.collapses.size());
    }
    groups_[c] = {group.ends, {group.collapses.begin(), group.collapses.end()}};  // copies without spare capacity
  });
}

std::vector<std::uint32_t> RegionLists::order(const Dependencies& needs, const std::vector<std::uint32_t>& anchors,
                                              unsigned threads) const {
  // The cells of each collapse, ascending.
  std::vector<std::size_t> first(std::size_t{needs.size()} + 1, 0);
  for (const Group& group : groups_) {
    for (const std::uint32_t collapse : group.collapses) ++first[collapse + 1];
  }
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<std::uint32_t> cells(first.back());
  {
    std::vector<std::size_t> next(first.begin(), first.end() - 1);
    for (std::size_t cell = 0; cell < cells_; ++cell) {
      for (const std::uint32_t collapse : of(cell)) cells[next[collapse]++] = static_cast<std::uint32_t>(cell);
    }
  }

  // Sorts the collapses into buckets by their first cell, and each bucket in parallel.
  const auto bucket_of = [&](std::uint32_t c) { return first[c] == first[c + 1] ? cells_ : cells[first[c]]; };
  std::vector<std::size_t> buckets(cells_ + 2, 0);
  for (std::uint32_t c = 0; c < needs.size(); ++c) ++buckets[bucket_of(c) + 1];
  std::partial_sum(buckets.begin(), buckets.end(), buckets.begin());
  std::vector<std::uint32_t> order(needs.size());
  {
    std::vector<std::size_t> next(buckets.begin(), buckets.end() - 1);
    for (std::uint32_t c = 0; c < needs.size(); ++c) order[next[bucket_of(c)]++] = c;
  }
  const auto compare_cells = [&](std::uint32_t a, std::uint32_t b) {
    std::size_t i = first[a], k = first[b];
    for (; i < first[a + 1] && k < first[b + 1]; ++i, ++k) {
      if (cells[i] != cells[k]) return cells[i] < cells[k] ? -1 : 1;
    }
    return i < first[a + 1] ? -1 : k < first[b + 1] ? 1 : 0;
  };
  const auto before = [&](std::uint32_t a, std::uint32_t b) {
    const int by_cells = compare_cells(a, b);
    return by_cells != 0 ? by_cells < 0 : a < b;
  };
  parallel_ranges(cells_ + 1, kGroup, threads, [&](std::size_t begin, std::size_t end) {
    NearestFirst nearest{needs, anchors};
    for (std::size_t bucket = begin; bucket < end; ++bucket) {
      std::sort(order.begin() + static_cast<std::ptrdiff_t>(buckets[bucket]),
                order.begin() + static_cast<std::ptrdiff_t>(buckets[bucket + 1]), before);
      for (std::size_t i = buckets[bucket], same = i; i < buckets[bucket + 1]; i = same) {
        while (same < buckets[bucket + 1] && compare_cells(order[i], order[same]) == 0) ++same;
        nearest.order({order.data() + i, same - i});
      }
    }
  });
  return order;
}

void RegionLists::renumber(const std::vector<std::uint32_t>& number, unsigned threads) {
  parallel_for(groups_.size(), threads, [&](std::size_t c, unsigned) {
    Group& group = groups_[c];
    for (std::uint32_t& collapse : group.collapses) collapse = number[collapse];
    auto first = group.collapses.begin();
    for (const std::size_t end : group.ends) {
      const auto last = group.collapses.begin() + static_cast<std::ptrdiff_t>(end);
      std::sort(first, last);
      first = last;
    }
  });
}

}  // namespace tactus::spm::offline
