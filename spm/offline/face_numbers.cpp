#include "spm/offline/face_numbers.hpp"

#include <algorithm>
#include <array>

#include "spm/codec/record_codes.hpp"
#include "spm/offline/face_order.hpp"
#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {
namespace {

constexpr std::uint32_t kBlock = 64, kLeaf = 8;  // faces
static_assert(kGrain % kBlock == 0);

class FaceNumbers {
 public:
  FaceNumbers(const TriangleMesh& mesh, const ModelSummary& summary, std::span<const RecordPart> parts,
              unsigned threads)
      : mesh_{mesh}, births_(summary.faces, Birth{kNone, kNone, kNone}) {
    // No face is born twice, so the threads write different elements.
    parallel_ranges(summary.records, kGrain, threads, [&](std::size_t begin, std::size_t end) {
      for (auto r = static_cast<std::uint32_t>(begin); r < end; ++r) {
        const RecordPart& part = parts[r];
        if (part.born_count == 0) continue;
        const std::uint32_t first = index(part.born[0].face());
        const std::uint32_t second = index(part.born_count == 2 ? part.born[1].face() : FaceId{kNone});
        births_[first] = {r, second, index(codec::anchor_of(part))};
        if (second != kNone) births_[second] = {r, first, first};
      }
    });
  }

  /// Sets the new numbers of the faces of a block.
  void number(std::uint32_t first, std::uint32_t count, std::vector<std::uint32_t>& numbers) const {
    std::array<PlacedFace, kBlock> faces;
    for (std::uint32_t i = 0; i < count; ++i) faces[i] = placed_face(first + i, first, count);
    divide_block(faces.data(), count);
    for (std::uint32_t i = 0; i < count; i += kLeaf) {
      number_leaf(faces.data() + i, std::min(kLeaf, count - i), first + i, numbers);
    }
  }

 private:
  struct Birth {
    std::uint32_t bearer;  // record whose first part bears the face
    std::uint32_t mate;    // other face that the record bears
    std::uint32_t
        origin;  // face to which the number is coded as a difference; the mate, if the face is the second of two
  };
  [[nodiscard]] bool share_an_edge(std::uint32_t a, std::uint32_t b) const {
    int shared = 0;
    for (const std::uint32_t v : mesh_.faces[a]) {
      for (const std::uint32_t w : mesh_.faces[b]) shared += v == w;
    }
    return shared >= 2;
  }
  void add_centre(std::uint32_t face, float share, std::array<float, 3>& centre) const {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      float sum = 0;
      for (const std::uint32_t v : mesh_.faces[face]) sum += mesh_.positions[v][axis] / 3;
      centre[axis] += share * sum;
    }
  }
  /// Returns the face with a position. Two faces of a record that share an edge get the same position, so that they are
  /// put into one leaf.
  [[nodiscard]] PlacedFace placed_face(std::uint32_t face, std::uint32_t first, std::uint32_t count) const {
    PlacedFace result{{0, 0, 0}, face};
    const std::uint32_t mate = births_[face].mate;
    const bool together = mate != kNone && mate - first < count && share_an_edge(face, mate);
    add_centre(std::min(face, together ? mate : face), together ? 0.5f : 1.0f, result.centre);
    if (together) add_centre(std::max(face, mate), 0.5f, result.centre);
    return result;
  }

  static void divide_block(PlacedFace* faces, std::size_t count) {
    while (count > kLeaf) {
      const std::size_t left = largest_power_below(count);
      split_along_longest_axis(faces, count, left);
      divide_block(faces, left);
      faces += left;
      count -= left;
    }
  }

  /// Numbers each face of a leaf after its origin. If several faces have one origin, the face with the longest chain of
  /// faces that follow it comes last.
  void number_leaf(const PlacedFace* faces, std::uint32_t count, std::uint32_t next,
                   std::vector<std::uint32_t>& numbers) const {
    struct Member {
      std::uint64_t birth;
      std::uint32_t face;
    };
    std::array<Member, kLeaf> members;
    for (std::uint32_t i = 0; i < count; ++i) {
      const Birth& birth = births_[faces[i].face];
      const bool second = birth.mate != kNone && birth.origin == birth.mate;
      members[i] = {birth.bearer == kNone ? 0 : 2 * std::uint64_t{birth.bearer} + 2 + second, faces[i].face};
    }
    std::sort(members.begin(), members.begin() + count, [](const Member& a, const Member& b) {
      return a.birth != b.birth ? a.birth < b.birth : a.face < b.face;
    });
    std::array<std::uint32_t, kLeaf> origin{};  // index of the origin in `members`; the face's own index if none
    std::array<std::uint32_t, kLeaf> depth{};   // length of the longest chain of faces that follow
    for (std::uint32_t i = count; i-- > 0;) {
      const std::uint32_t from = births_[members[i].face].origin;
      for (origin[i] = 0; origin[i] < i && members[origin[i]].face != from;) ++origin[i];
      if (origin[i] < i) depth[origin[i]] = std::max(depth[origin[i]], depth[i] + 1);
    }
    const auto visit = [&](std::uint32_t i, const auto& visit_next) -> void {
      numbers[members[i].face] = next++;
      for (std::uint32_t d = 0; d < depth[i]; ++d) {
        for (std::uint32_t k = i + 1; k < count; ++k) {
          if (origin[k] == i && depth[k] == d) visit_next(k, visit_next);
        }
      }
    };
    for (std::uint32_t i = 0; i < count; ++i) {
      if (origin[i] == i) visit(i, visit);
    }
  }

  const TriangleMesh& mesh_;
  std::vector<Birth> births_;  // by face; kNone if it does not apply
};

}  // namespace

void number_faces(const TriangleMesh& mesh, const ModelSummary& summary, std::vector<BaseFace>& base_faces,
                  std::span<RecordPart> parts, unsigned threads) {
  std::vector<std::uint32_t> numbers(summary.faces);
  {
    const FaceNumbers faces{mesh, summary, {parts.data(), parts.size()}, threads};
    parallel_ranges(summary.faces, kGrain, threads, [&](std::size_t first, std::size_t last) {
      for (std::size_t f = first; f < last; f += kBlock) {
        faces.number(static_cast<std::uint32_t>(f), static_cast<std::uint32_t>(std::min<std::size_t>(kBlock, last - f)),
                     numbers);
      }
    });
  }
  const auto renumbered = [&](FaceId face) { return FaceId{numbers[index(face)]}; };
  for (BaseFace& face : base_faces) face.face = renumbered(face.face);
  std::sort(base_faces.begin(), base_faces.end(), [](const BaseFace& a, const BaseFace& b) { return a.face < b.face; });
  parallel_ranges(parts.size(), kGrain, threads, [&](std::size_t first, std::size_t last) {
    for (std::size_t p = first; p < last; ++p) {
      RecordPart& part = parts[p];
      for (int i = 0; i < part.born_count; ++i) {
        const BornRef ref = part.born[i];
        part.born[i] = BornRef::make(renumbered(ref.face()), ref.order(), ref.is_finest());
      }
      for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
        const DeformedRef ref = part.deformed(i);
        part.set_deformed(i, DeformedRef::make(renumbered(ref.face()), ref.corner(), ref.is_finest()));
      }
    }
  });
}

}  // namespace tactus::spm::offline
