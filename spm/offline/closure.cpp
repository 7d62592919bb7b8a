#include "spm/offline/closure.hpp"

#include <algorithm>
#include <functional>
#include <span>
#include <string>

#include "spm/assert.hpp"
#include "spm/ids.hpp"
#include "spm/offline/arrange.hpp"
#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {
namespace {

class DependencyFinder {
 public:
  DependencyFinder(Collapses& collapses, std::size_t vertices, unsigned threads)
      : collapses_{collapses}, threads_{threads} {
    out_.segment.assign(1, 0);
    for (const Segment& segment : collapses.segments) out_.segment.push_back(out_.segment.back() + segment.size());
    out_.removed_by.assign(vertices, kNone);
    out_.level.assign(out_.size(), 0);
    out_.first.assign(std::size_t{out_.size()} + 1, 0);
    writer_.assign(collapses.corners.size(), kNone);
    backwards_.resize(collapses.segments.size());
  }

  /// Undoes the collapses, beginning with the last, so that the level of a record is known before a record that depends
  /// on it is visited. Segments of one round share no face and no removed vertex, so threads can undo them in parallel.
  Dependencies run() {
    const std::size_t segments = collapses_.segments.size();
    parallel_for(segments, threads_, [this](std::size_t s, unsigned) {
      for (std::uint32_t i = 0; i < collapses_.segments[s].size(); ++i) {
        out_.removed_by[collapses_.segments[s].sequence[i].u] = out_.segment[s] + i;
      }
    });
    for (std::size_t round = collapses_.rounds.size() - 1; round-- > 0;) {
      const std::size_t first = collapses_.rounds[round];
      parallel_for(collapses_.rounds[round + 1] - first, threads_, [&](std::size_t i, unsigned) { undo(first + i); });
    }
    std::uint32_t sum = 0;
    for (std::uint32_t& count : out_.first) {
      const std::uint32_t own = count;
      count = sum;
      sum += own;
    }
    out_.needs.resize(sum);
    parallel_for(segments, threads_, [this](std::size_t s, unsigned) {
      std::reverse_copy(backwards_[s].begin(), backwards_[s].end(), out_.needs.begin() + out_.first[out_.segment[s]]);
      backwards_[s] = {};
    });
    for (const std::uint16_t level : out_.level) out_.max_level = std::max<std::uint32_t>(out_.max_level, level);
    return std::move(out_);
  }

 private:
  /// Undoes the collapses of segment s, and finds level and needs of each.
  void undo(std::size_t s) {
    Segment& segment = collapses_.segments[s];
    std::vector<std::uint32_t> own;
    std::vector<std::uint32_t>& all = backwards_[s];
    all.reserve(3 * std::size_t{segment.size()});
    for (std::uint32_t i = segment.size(); i-- > 0;) {
      const std::uint32_t id = out_.segment[s] + i;
      find_needs(segment, i, id, own);
      std::uint32_t level = 1;
      for (const std::uint32_t j : own) level = std::max(level, 1u + out_.level[j]);
      if (level > 0xffff) {
        throw ModelError{"vertex " + std::to_string(segment.sequence[i].u) + ": found a level above 65535"};
      }
      out_.level[id] = static_cast<std::uint16_t>(level);
      std::sort(own.begin(), own.end(), std::greater<>{});
      all.insert(all.end(), own.begin(), own.end());
      out_.first[id] = static_cast<std::uint32_t>(own.size());
    }
  }

  /// Undoes collapse i of a segment, record `id`, and sets `own` to the records that it needs.
  void find_needs(Segment& segment, std::uint32_t i, std::uint32_t id, std::vector<std::uint32_t>& own) {
    const Collapse &c = segment.sequence[i], &end = segment.sequence[i + 1];
    own.clear();
    const auto need = [&own](std::uint32_t record) {
      if (record != kNone && std::find(own.begin(), own.end(), record) == own.end()) own.push_back(record);
    };
    need(out_.removed_by[c.t]);
    for (std::uint32_t k = c.first_dying; k < end.first_dying; ++k) {
      const BornRef removed_faces = segment.removed_faces[k];
      const std::uint32_t x = segment.removed_third_corners[k];
      need(out_.removed_by[x]);
      collapses_.corners[index(removed_faces.face())] = born_face(removed_faces.order(), c.u, c.t, x);
      writer_[index(removed_faces.face())] = id;
    }
    const std::span<MovedCorner> fan{segment.moved.data() + c.first_moved, end.first_moved - c.first_moved};
    for (MovedCorner& moved : fan) {
      const Triangle& face = collapses_.corners[moved.face()];
      moved.set_corner(static_cast<std::uint32_t>(std::find(face.begin(), face.end(), c.t) - face.begin()));
      TACTUS_CHECK(moved.corner() < 3);
    }
    order_fan(fan, collapses_.corners);
    for (const MovedCorner& moved : fan) {
      Triangle& face = collapses_.corners[moved.face()];
      need(writer_[moved.face()]);
      need(out_.removed_by[face[(moved.corner() + 1) % 3]]);
      need(out_.removed_by[face[(moved.corner() + 2) % 3]]);
      face[moved.corner()] = c.u;
      writer_[moved.face()] = id;
    }
  }

  Collapses& collapses_;
  unsigned threads_;
  Dependencies out_;
  std::vector<std::uint32_t> writer_;                  // by face: the newest record that bore or deformed it
  std::vector<std::vector<std::uint32_t>> backwards_;  // by segment: needs of its collapses, the last collapse first
};

}  // namespace

Dependencies dependencies(Collapses& collapses, std::size_t vertices, unsigned threads) {
  return DependencyFinder{collapses, vertices, threads}.run();
}

}  // namespace tactus::spm::offline
