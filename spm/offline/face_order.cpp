#include "spm/offline/face_order.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {

std::size_t largest_power_below(std::size_t count) {
  std::size_t power = 1;
  while (2 * power < count) power *= 2;
  return power;
}

namespace {

using Four = float __attribute__((vector_size(16)));
using FourInts = std::int32_t __attribute__((vector_size(16)));
static_assert(sizeof(PlacedFace) == sizeof(Four));

std::size_t longest_axis(const PlacedFace* faces, std::size_t count) {
  const auto at = [faces](std::size_t i) {
    Four lanes;
    std::memcpy(&lanes, faces + i, sizeof lanes);
    return lanes;
  };
  Four low = at(0), high = low;  // the last lane is unused
  for (std::size_t i = 1; i < count; ++i) {
    const Four face = at(i);
    low = face < low ? face : low;
    high = face > high ? face : high;
  }
  const Four extent = high - low;
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (extent[k] > extent[axis]) axis = k;
  }
  return axis;
}

struct Before {
  std::size_t axis;
  bool operator()(const PlacedFace& a, const PlacedFace& b) const {
    return a.centre[axis] != b.centre[axis] ? a.centre[axis] < b.centre[axis] : a.face < b.face;
  }
};

constexpr std::size_t kFew = 16;

/// Sorts at most kFew faces: counts for each face the faces before it. Has no branches that depend on the faces, which
/// would be mispredicted.
void sort_few(PlacedFace* faces, std::size_t count, std::size_t axis) {
  std::array<PlacedFace, kFew> from;
  std::array<Four, kFew / 4> place{};
  std::array<FourInts, kFew / 4> number{}, rank{};
  for (std::size_t i = 0; i < count; ++i) {
    from[i] = faces[i];
    place[i / 4][i % 4] = faces[i].centre[axis];
    number[i / 4][i % 4] = static_cast<std::int32_t>(faces[i].face);  // below 2^28
  }
  for (std::size_t i = 0; i < count; ++i) {
    const float x = from[i].centre[axis];
    const Four at{x, x, x, x};
    const auto f = static_cast<std::int32_t>(from[i].face);
    const FourInts face{f, f, f, f};
    for (std::size_t four = 0; 4 * four < count; ++four) {
      rank[four] -= (at < place[four]) | ((at == place[four]) & (face < number[four]));
    }
  }
  for (std::size_t i = 0; i < count; ++i) faces[rank[i / 4][i % 4]] = from[i];
}

/// Moves the faces that are before `pivot` in the order to the front and returns their number. Has no branches that
/// depend on the faces.
std::size_t move_to_front(PlacedFace* faces, std::size_t count, std::size_t axis, const PlacedFace& pivot) {
  const float at = pivot.centre[axis];
  std::size_t front = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const float x = faces[i].centre[axis];
    const PlacedFace face = faces[i];
    faces[i] = faces[front];
    faces[front] = face;
    front += static_cast<std::size_t>(x < at) | (static_cast<std::size_t>(x == at) & (face.face < pivot.face));
  }
  return front;
}

/// Returns a pivot from a sample. It is probably near the `nth` face, on the side of the larger part, so that the `nth`
/// face is in the smaller part. It is never the first or last face of the sample.
PlacedFace choose_pivot(const PlacedFace* faces, std::size_t count, std::size_t nth, Before before) {
  constexpr std::size_t kMax = 127;
  std::array<PlacedFace, kMax> sample;
  const std::size_t size = count < 128 ? 5 : count < 2048 ? 21 : kMax;
  for (std::size_t i = 0; i < size; ++i) sample[i] = faces[i * count / size];
  const std::size_t at = nth * size / count, beyond = size < kMax ? 1 : 5;
  const std::size_t rank = nth < count / 2 || at < beyond ? at + beyond : at - beyond;
  const auto chosen = sample.begin() + std::clamp<std::size_t>(rank, 1, size - 2);
  std::nth_element(sample.begin(), chosen, sample.begin() + size, before);
  return *chosen;
}

/// Like std::nth_element, but with another order within the two parts.
void select(PlacedFace* faces, std::size_t count, std::size_t nth, std::size_t axis) {
  for (std::size_t steps = 0; count > kFew; ++steps) {
    if (steps == 64) {  // the samples were bad; std::nth_element is linear
      std::nth_element(faces, faces + nth, faces + count, Before{axis});
      return;
    }
    const std::size_t front = move_to_front(faces, count, axis, choose_pivot(faces, count, nth, Before{axis}));
    if (front > nth) {
      count = front;
    } else {
      faces += front;
      count -= front;
      nth -= front;
    }
    if (nth == 0) return;
  }
  sort_few(faces, count, axis);
}

}  // namespace

void split_along_longest_axis(PlacedFace* faces, std::size_t count, std::size_t left) {
  const std::size_t axis = longest_axis(faces, count);
  if (count == 2) {
    if (Before{axis}(faces[1], faces[0])) std::swap(faces[0], faces[1]);
  } else {
    select(faces, count, left, axis);
  }
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

/// Splits every block of more than `max` faces in two with `split`, until no block has more. `left_of(count)` is the
/// number of faces of the left part. Each pass splits all such blocks once, in parallel. Returns the start of each
/// block and the end of the last.
template <class LeftOf, class Split>
std::vector<std::size_t> split_all(std::span<PlacedFace> faces, std::size_t max, unsigned threads, LeftOf left_of,
                                   Split split) {
  std::vector<std::size_t> starts{0, faces.size()}, middles, next;
  while (true) {
    middles.assign(starts.size() - 1, 0);
    bool split_one = false;
    for (std::size_t i = 0; i + 1 < starts.size(); ++i) {
      const std::size_t count = starts[i + 1] - starts[i];
      if (count <= max) continue;
      middles[i] = left_of(count);
      split_one = true;
    }
    if (!split_one) return starts;
    parallel_for(middles.size(), threads, [&](std::size_t i, unsigned) {
      if (middles[i] != 0) split(faces.data() + starts[i], starts[i + 1] - starts[i], middles[i]);
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

std::vector<std::size_t> divide(std::span<PlacedFace> faces, std::size_t max, double share, unsigned threads) {
  const auto left_of = [share](std::size_t count) {
    const auto left = static_cast<std::size_t>(share * static_cast<double>(count));
    return std::clamp<std::size_t>(left, 1, count - 1);
  };
  // std::nth_element instead of split_along_longest_axis(): the order within a block affects the result.
  return split_all(faces, max, threads, left_of, [](PlacedFace* block, std::size_t count, std::size_t left) {
    std::nth_element(block, block + left, block + count, Before{longest_axis(block, count)});
  });
}

std::vector<std::uint32_t> face_order(const TriangleMesh& mesh, unsigned threads) {
  std::vector<PlacedFace> faces(mesh.faces.size());
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
  const std::vector<std::size_t> blocks =
      split_all(faces, kGrain, threads, largest_power_below, split_along_longest_axis);
  parallel_for(blocks.size() - 1, threads,
               [&](std::size_t i, unsigned) { order(faces.data() + blocks[i], blocks[i + 1] - blocks[i]); });
  std::vector<std::uint32_t> result(faces.size());
  for (std::size_t i = 0; i < faces.size(); ++i) result[i] = faces[i].face;
  return result;
}

}  // namespace tactus::spm::offline
