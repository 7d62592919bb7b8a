#include "spm/offline/simplify.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <span>

#include "spm/offline/face_order.hpp"
#include "spm/offline/parallel.hpp"
#include "spm/offline/patch.hpp"

namespace tactus::spm::offline {
namespace {

constexpr std::uint32_t kShrink = 4;      // faces of a block before a round, divided by those after it
constexpr std::uint32_t kTileRounds = 3;  // rounds in which each block lies in one tile

/// Returns a power of two that scales the mean edge to about 1. Scaling by it has no rounding error.
float scale_of(const TriangleMesh& mesh, unsigned threads) {
  const double sum = parallel_sum(mesh.faces.size(), threads, [&mesh](std::size_t i) {
    const Triangle& f = mesh.faces[i];
    double length2 = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double along = double{mesh.positions[f[1]][axis]} - double{mesh.positions[f[0]][axis]};
      length2 += along * along;
    }
    return std::sqrt(length2);
  });
  const double mean = sum / static_cast<double>(mesh.faces.size());
  return mean > 0 && std::isfinite(mean) ? static_cast<float>(std::ldexp(1, -std::ilogb(mean))) : 1.0f;
}

class Simplifier {
 public:
  Simplifier(const TriangleMesh& mesh, const SimplifyOptions& options, unsigned threads,
             const std::function<void(double)>& progress)
      : mesh_{mesh},
        options_{options},
        threads_{thread_count(threads)},
        progress_{progress},
        surface_{mesh, mesh.faces, {}, {}, {}, {}, scale_of(mesh, threads_)},
        patches_(threads_) {
    options_.block_faces = std::max(options_.block_faces, 16u);
    surface_.state.assign(mesh.faces.size(), Surface::kAlive);
    surface_.quadrics.resize(mesh.positions.size());
    surface_.owner.resize(mesh.positions.size());
    surface_.local_number.assign(mesh.positions.size(), 0);
    alive_.resize(mesh.faces.size());
    for (std::uint32_t f = 0; f < alive_.size(); ++f) alive_[f] = f;
    const std::size_t tile_faces = options_.tile_faces > 0 ? std::max(options_.tile_faces, 16u) : alive_.size();
    for (std::size_t at = 0; at < alive_.size(); at += tile_faces) tiles_.push_back(at);
    tiles_.push_back(alive_.size());
  }

  Collapses run() {
    for (std::uint32_t round = 0;; ++round) {
      out_.rounds.push_back(out_.segments.size());
      if (round == kTileRounds) tiles_ = {0, alive_.size()};
      const std::size_t before = alive_.size();
      if (before <= options_.block_faces || before <= options_.base_faces) break;
      simplify_blocks(round);
      if (alive_.size() > before - before / 16) break;  // few legal collapses are left within blocks
    }
    std::fill(surface_.owner.begin(), surface_.owner.end(), 0);
    const bool is_first_round = out_.segments.empty();
    out_.segments.push_back(patch(0).simplify({alive_, 0, options_.base_faces, is_first_round, true}, progress_));
    out_.rounds.push_back(out_.segments.size());
    drop_removed();
    std::sort(alive_.begin(), alive_.end());
    for (const std::uint32_t f : alive_) out_.base_finest.push_back((surface_.state[f] & Surface::kChanged) == 0);
    out_.base = std::move(alive_);
    out_.corners = std::move(surface_.corners);
    return std::move(out_);
  }

 private:
  void simplify_blocks(std::uint32_t round) {
    const std::vector<std::size_t> blocks = round == 0 ? even_blocks() : divided_blocks(round);
    assign_owners(blocks);
    if (round == 0) compute_shared_quadrics();
    const std::size_t first = out_.segments.size();
    out_.segments.resize(first + blocks.size() - 1);
    const std::size_t faces = alive_.size();
    parallel_for(blocks.size() - 1, threads_, [&](std::size_t i, unsigned worker) {
      const auto count = static_cast<std::uint32_t>(blocks[i + 1] - blocks[i]);
      // The base mesh may have more faces than a quarter of the mesh.
      const auto target = static_cast<std::uint32_t>(
          std::max<std::uint64_t>(count / kShrink, std::uint64_t{options_.base_faces} * count / faces + 1));
      const std::span<const std::uint32_t> block{alive_.data() + blocks[i], count};
      out_.segments[first + i] =
          patch(worker).simplify({block, static_cast<std::uint32_t>(i), target, round == 0, false});
      if (progress_ && worker == 0) {
        progress_(1 - double(faces) / double(mesh_.faces.size()) * (1 - 0.75 * double(i) / double(blocks.size())));
      }
    });
    drop_removed();
  }

  Patch& patch(unsigned worker) {
    if (!patches_[worker]) patches_[worker].emplace(surface_, options_);
    return *patches_[worker];
  }

  /// Drops from `alive_` and its tiles the faces that collapses have removed.
  void drop_removed() {
    std::size_t to = 0;
    for (std::size_t tile = 0; tile + 1 < tiles_.size(); ++tile) {
      const std::size_t first = tiles_[tile];
      tiles_[tile] = to;
      for (std::size_t i = first; i < tiles_[tile + 1]; ++i)
        if ((surface_.state[alive_[i]] & Surface::kAlive) != 0) alive_[to++] = alive_[i];
    }
    alive_.resize(to);
    tiles_.back() = to;
  }

  std::vector<std::size_t> even_blocks() const {
    std::vector<std::size_t> blocks;
    for (std::size_t tile = 0; tile + 1 < tiles_.size(); ++tile)
      for (std::size_t at = tiles_[tile]; at < tiles_[tile + 1]; at += options_.block_faces) blocks.push_back(at);
    blocks.push_back(alive_.size());
    return blocks;
  }

  /// Cuts at other positions than the previous round, so that the previous borders of blocks are now inside blocks.
  std::vector<std::size_t> divided_blocks(std::uint32_t round) {
    std::vector<PlacedFace> placed(alive_.size());
    parallel_ranges(alive_.size(), kGrain, threads_, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        placed[i].face = alive_[i];
        placed[i].centre = {0, 0, 0};
        for (const std::uint32_t v : surface_.corners[alive_[i]]) {
          for (std::size_t axis = 0; axis < 3; ++axis) placed[i].centre[axis] += mesh_.positions[v][axis] / 3;
        }
      }
    });
    constexpr std::array<double, 4> kShares{0.38, 0.6, 0.44, 0.67};
    std::vector<std::size_t> blocks{0};
    for (std::size_t tile = 0; tile + 1 < tiles_.size(); ++tile) {
      const std::span<PlacedFace> faces{placed.data() + tiles_[tile], placed.data() + tiles_[tile + 1]};
      if (faces.empty()) continue;
      const double share = kShares[round % kShares.size()];
      const std::vector<std::size_t> starts = divide(faces, options_.block_faces, share, threads_);
      for (std::size_t i = 1; i < starts.size(); ++i) blocks.push_back(tiles_[tile] + starts[i]);
    }
    for (std::size_t i = 0; i < placed.size(); ++i) alive_[i] = placed[i].face;
    return blocks;
  }

  /// Sets Surface::owner for all vertices of faces that are not removed.
  void assign_owners(const std::vector<std::size_t>& blocks) {
    constexpr std::uint32_t kUnseen = kNone - 1;
    std::fill(surface_.owner.begin(), surface_.owner.end(), kUnseen);
    parallel_for(blocks.size() - 1, threads_, [&](std::size_t item, unsigned) {
      const auto block = static_cast<std::uint32_t>(item);
      for (std::size_t i = blocks[item]; i < blocks[item + 1]; ++i) {
        for (const std::uint32_t v : surface_.corners[alive_[i]]) {
          std::uint32_t* owner = &surface_.owner[v];
          std::uint32_t seen = __atomic_load_n(owner, __ATOMIC_RELAXED);
          if (seen == kUnseen &&
              __atomic_compare_exchange_n(owner, &seen, block, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
            continue;
          }
          // Whichever thread writes first, a vertex of two blocks is shared at the end.
          if (seen != block && seen != Surface::kShared) __atomic_store_n(owner, Surface::kShared, __ATOMIC_RELAXED);
        }
      }
    });
  }

  /// Computes the quadrics of all shared vertices in the first round. A patch cannot compute these quadrics, because it
  /// lacks some faces of a shared vertex. In later rounds, these faces are no longer in their finest version.
  void compute_shared_quadrics() {
    using Pair = std::array<std::uint32_t, 2>;
    std::vector<std::vector<Pair>> found(mesh_.faces.size() / kGrain + 1);
    parallel_ranges(mesh_.faces.size(), kGrain, threads_, [&](std::size_t first, std::size_t last) {
      for (std::size_t f = first; f < last; ++f) {
        for (std::uint32_t k = 0; k < 3; ++k) {
          const std::uint32_t v = mesh_.faces[f][k];
          if (surface_.owner[v] == Surface::kShared) {
            found[first / kGrain].push_back({v, 4 * static_cast<std::uint32_t>(f) + k});
          }
        }
      }
    });
    std::vector<Pair> stars;  // vertex, 4 * face + corner
    for (const std::vector<Pair>& some : found) stars.insert(stars.end(), some.begin(), some.end());
    parallel_sort(stars, threads_, std::less<>{});
    constexpr std::size_t kFewStars = 1 << 12;
    const auto same_vertex = [&stars](std::size_t i) { return stars[i][0] == stars[i - 1][0]; };
    parallel_groups(stars.size(), kFewStars, threads_, same_vertex, [&](std::size_t first, std::size_t last) {
      compute_quadrics({stars.data() + first, last - first});
    });
  }

  /// Computes the quadrics of some vertices. `stars`: all face corners at these vertices (vertex, 4 * face + corner),
  /// ascending.
  void compute_quadrics(std::span<const std::array<std::uint32_t, 2>> stars) {
    std::vector<std::array<std::uint32_t, 2>> edges;  // neighbour, face
    for (std::size_t i = 0; i < stars.size();) {
      const std::uint32_t v = stars[i][0];
      Quadric& quadric = surface_.quadrics[v];
      edges.clear();
      for (; i < stars.size() && stars[i][0] == v; ++i) {
        const std::uint32_t f = stars[i][1] / 4, k = stars[i][1] % 4;
        float length = 0;
        const Offset normal = normal_of(f, length);
        quadric.add_plane(normal, length / 2);
        edges.push_back({mesh_.faces[f][(k + 1) % 3], f});
        edges.push_back({mesh_.faces[f][(k + 2) % 3], f});
      }
      std::sort(edges.begin(), edges.end());
      for (std::size_t k = 0; k < edges.size(); ++k) {
        const bool is_border =
            (k == 0 || edges[k - 1][0] != edges[k][0]) && (k + 1 == edges.size() || edges[k + 1][0] != edges[k][0]);
        if (!is_border) continue;
        float length = 0;
        add_border_plane(quadric, between(surface_.scaled(v), surface_.scaled(edges[k][0])),
                         normal_of(edges[k][1], length));
      }
    }
  }

  Offset normal_of(std::uint32_t f, float& length) const {
    const Triangle& t = mesh_.faces[f];
    return unit_normal({surface_.scaled(t[0]), surface_.scaled(t[1]), surface_.scaled(t[2])}, length);
  }

  const TriangleMesh& mesh_;
  SimplifyOptions options_;
  unsigned threads_;
  const std::function<void(double)>& progress_;
  Surface surface_;
  std::vector<std::optional<Patch>> patches_;  // by worker
  std::vector<std::uint32_t> alive_;           // faces that are not removed, in the order of the blocks
  std::vector<std::size_t> tiles_;             // index of the first face of each tile in `alive_`, and the end
  Collapses out_;
};

}  // namespace

Collapses simplify(const TriangleMesh& mesh, const SimplifyOptions& options, unsigned threads,
                   const std::function<void(double)>& progress) {
  return Simplifier{mesh, options, threads, progress}.run();
}

}  // namespace tactus::spm::offline
