#include "spm/offline/closure.hpp"

#include <algorithm>
#include <functional>
#include <string>
#include <utility>

#include "spm/ids.hpp"
#include "spm/record.hpp"

namespace tactus::spm::offline {

Dependencies dependencies(const Collapses& collapses, std::size_t vertices) {
  const auto count = static_cast<std::uint32_t>(collapses.sequence.size());
  std::vector<std::uint32_t> removed_by(vertices, kNone);
  for (std::uint32_t i = 0; i < count; ++i) removed_by[collapses.sequence[i].u] = i;

  // Undo the collapses, last first. A record's needs are known before those of all that need it.
  std::vector<Triangle> corners = collapses.corners;
  std::vector<std::uint32_t> writer(corners.size(), kNone);
  Dependencies out;
  out.level.assign(count, 0);
  out.first.assign(std::size_t{count} + 1, 0);
  std::vector<std::uint32_t> backwards, own;  // needs of collapse count - 1 first
  backwards.reserve(3 * std::size_t{count});
  for (std::uint32_t i = count; i-- > 0;) {
    const Collapse& c = collapses.sequence[i];
    own.clear();
    const auto need = [&own](std::uint32_t record) {
      if (record != kNone && std::find(own.begin(), own.end(), record) == own.end()) own.push_back(record);
    };
    need(removed_by[c.t]);
    for (std::uint32_t k = 0; k < c.dying_count; ++k) {
      const DyingFace& dying = collapses.dying[c.first_dying + k];
      need(removed_by[dying.x]);
      const BornCorners at = born_corners(dying.order);
      corners[dying.face][static_cast<std::size_t>(at.u)] = c.u;
      corners[dying.face][static_cast<std::size_t>(at.t)] = c.t;
      corners[dying.face][static_cast<std::size_t>(at.x)] = dying.x;
      writer[dying.face] = i;
    }
    for (std::uint32_t k = 0; k < c.moved_count; ++k) {
      const MovedCorner& moved = collapses.moved[c.first_moved + k];
      Triangle& face = corners[moved.face];
      need(writer[moved.face]);
      need(removed_by[face[(moved.corner + 1u) % 3]]);
      need(removed_by[face[(moved.corner + 2u) % 3]]);
      face[moved.corner] = c.u;
      writer[moved.face] = i;
    }
    std::uint32_t level = 1;
    for (const std::uint32_t j : own) level = std::max(level, 1u + out.level[j]);
    if (level > 0xffff) throw ModelError{"vertex " + std::to_string(c.u) + ": depends on more than 65535 levels"};
    out.level[i] = static_cast<std::uint16_t>(level);
    out.max_level = std::max(out.max_level, level);
    std::sort(own.begin(), own.end(), std::greater<>{});
    backwards.insert(backwards.end(), own.begin(), own.end());
    out.first[i] = static_cast<std::uint32_t>(own.size());
  }
  std::uint32_t sum = 0;
  for (std::uint32_t& first : out.first) sum += std::exchange(first, sum);
  out.needs.assign(backwards.rbegin(), backwards.rend());
  return out;
}

}  // namespace tactus::spm::offline
