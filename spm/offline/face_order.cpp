#include "spm/offline/face_order.hpp"

#include <algorithm>
#include <limits>

#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {

std::size_t largest_power_below(std::size_t count) {
  std::size_t power = 1;
  while (2 * power < count) power *= 2;
  return power;
}

void split_along_longest_axis(PlacedFace* faces, std::size_t count, std::size_t left) {
  std::array<float, 3> low, high;
  low.fill(std::numeric_limits<float>::infinity());
  high.fill(-std::numeric_limits<float>::infinity());
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], faces[i].centre[axis]);
      high[axis] = std::max(high[axis], faces[i].centre[axis]);
    }
  }
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
  }
  std::nth_element(faces, faces + left, faces + count, [axis](const PlacedFace& a, const PlacedFace& b) {
    return a.centre[axis] != b.centre[axis] ? a.centre[axis] < b.centre[axis] : a.face < b.face;
  });
}

namespace {

void order(PlacedFace* faces, std::size_t count) {
  while (count > 1) {
    const std::size_t left = largest_power_below(count);
    split_along_longest_axis(faces, count, left);
    order(faces, left);
    faces += left;
    count -= left;
  }
}

/// Splits every block of more than `most` where `left_of` says, again and again; one generation at a time.
template <class LeftOf>
std::vector<std::size_t> split_all(std::vector<PlacedFace>& faces, std::size_t most, unsigned threads, LeftOf left_of) {
  std::vector<std::size_t> starts{0, faces.size()}, middles, next;
  while (true) {
    middles.assign(starts.size() - 1, 0);
    bool split_one = false;
    for (std::size_t i = 0; i + 1 < starts.size(); ++i) {
      const std::size_t count = starts[i + 1] - starts[i];
      if (count <= most) continue;
      middles[i] = left_of(count);
      split_one = true;
    }
    if (!split_one) return starts;
    parallel_for(middles.size(), threads, [&](std::size_t i, unsigned) {
      if (middles[i] != 0) split_along_longest_axis(faces.data() + starts[i], starts[i + 1] - starts[i], middles[i]);
    });
    next.clear();
    for (std::size_t i = 0; i < middles.size(); ++i) {
      next.push_back(starts[i]);
      if (middles[i] != 0) next.push_back(starts[i] + middles[i]);
    }
    next.push_back(faces.size());
    starts.swap(next);
  }
}

}  // namespace

std::vector<std::size_t> divide(std::vector<PlacedFace>& faces, std::size_t most, double share, unsigned threads) {
  return split_all(faces, most, threads, [share](std::size_t count) {
    const auto left = static_cast<std::size_t>(share * static_cast<double>(count));
    return std::clamp<std::size_t>(left, 1, count - 1);
  });
}

std::vector<std::uint32_t> face_order(const TriangleMesh& mesh, unsigned threads) {
  std::vector<PlacedFace> faces(mesh.faces.size());
  constexpr std::size_t kGrain = 1 << 16;
  parallel_ranges(faces.size(), kGrain, threads, [&](std::size_t first, std::size_t last) {
    for (std::size_t f = first; f < last; ++f) {
      faces[f].face = static_cast<std::uint32_t>(f);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        float sum = 0;
        for (const std::uint32_t v : mesh.faces[f]) sum += mesh.positions[v][axis] / 3;
        faces[f].centre[axis] = sum;
      }
    }
  });
  const std::vector<std::size_t> blocks = split_all(faces, kGrain, threads, largest_power_below);
  parallel_for(blocks.size() - 1, threads,
               [&](std::size_t i, unsigned) { order(faces.data() + blocks[i], blocks[i + 1] - blocks[i]); });
  std::vector<std::uint32_t> result(faces.size());
  for (std::size_t i = 0; i < faces.size(); ++i) result[i] = faces[i].face;
  return result;
}

}  // namespace tactus::spm::offline
