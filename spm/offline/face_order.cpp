#include "spm/offline/face_order.hpp"

#include <algorithm>
#include <limits>

namespace tactus::spm::offline {
namespace {

struct Item {
  std::array<float, 3> centre;
  std::uint32_t face;
};

void order(Item* items, std::size_t count) {
  while (count > 1) {
    std::array<float, 3> low, high;
    low.fill(std::numeric_limits<float>::infinity());
    high.fill(-std::numeric_limits<float>::infinity());
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = std::min(low[axis], items[i].centre[axis]);
        high[axis] = std::max(high[axis], items[i].centre[axis]);
      }
    }
    std::size_t axis = 0;
    for (std::size_t k = 1; k < 3; ++k) {
      if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    }
    std::size_t left = 1;  // the largest power of two below count
    while (2 * left < count) left *= 2;
    std::nth_element(items, items + left, items + count, [axis](const Item& a, const Item& b) {
      return a.centre[axis] != b.centre[axis] ? a.centre[axis] < b.centre[axis] : a.face < b.face;
    });
    order(items, left);
    items += left;
    count -= left;
  }
}

}  // namespace

std::vector<std::uint32_t> face_order(const TriangleMesh& mesh) {
  std::vector<Item> items(mesh.faces.size());
  for (std::uint32_t f = 0; f < items.size(); ++f) {
    items[f].face = f;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      float sum = 0;
      for (const std::uint32_t v : mesh.faces[f]) sum += mesh.positions[v][axis] / 3;
      items[f].centre[axis] = sum;
    }
  }
  order(items.data(), items.size());
  std::vector<std::uint32_t> result(items.size());
  for (std::size_t i = 0; i < items.size(); ++i) result[i] = items[i].face;
  return result;
}

}  // namespace tactus::spm::offline
