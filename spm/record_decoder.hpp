/// Decodes one vertex-split record of a message against the mesh at the loaded front. No other code resolves and checks
/// records that are not trusted: the cache of an HRTC and the reader of model files both use the decoder.
///
/// A message names some faces by id and implies the others. The decoder looks up the named faces, finds the implied
/// ones on the front, and checks that the record fits the mesh. It also applies the split to the corners of the front.
///
/// `Store` is the storage of the caller for decoded records:
///
///     Vertex, Face, Part               index types of the decoded record
///     front()                          returns the LoadedFront of `Face` and `Vertex`
///     vertex(VertexId)                 returns the vertex, or kNone if it is not loaded
///     face(FaceId)                     returns the face, or kNone if it is not loaded
///     add_born_face(FaceId, Part, i)   adds a face that is not loaded, as face `i` of `Part`, whose `born[i]` is set;
///                                      returns its index
///     position(Vertex)                 returns three floats
///
/// Realtime if the functions of `Store` are. Source: Rossignac 1999 (Edgebreaker).
#pragma once

#include <array>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "spm/loaded_front.hpp"
#include "spm/model.hpp"
#include "spm/position_predictor.hpp"
#include "spm/record.hpp"
#include "spm/region_data.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

enum class RecordResult : std::uint8_t {
  kDecoded,
  kIncomplete,  ///< the record names a vertex or a face that is not loaded
  kMalformed    ///< the record contradicts the mesh at the front
};

template <class Store>
class RecordDecoder {
 public:
  using Vertex = typename Store::Vertex;
  using Face = typename Store::Face;
  using Part = typename Store::Part;
  using Decoded = BasicRecordPart<Vertex, Face, Part>;

  /// `u`: the vertex that the record adds. `store` and `summary` must outlive the decoder.
  RecordDecoder(Store& store, const ModelSummary& summary, Vertex u) noexcept
      : store_{store}, summary_{summary}, u_{u} {}

  /// Decodes the next part into `target`, which is part `at` of `store`. Sets `target.next` to kNone. If the result is
  /// not kDecoded, `target` contains the faces that were changed before the error, so that the caller can undo them.
  [[nodiscard]] RecordResult add(const RecordPart& source, Part at, Decoded& target) noexcept {
    target.parent = parent_;
    target.next = kNone;
    target.born_count = 0;
    target.deformed_count = 0;
    target.finest = 0;
    target.radius = source.radius;
    const std::uint32_t changes = std::uint32_t{source.born_count} + source.deformed_count;
    changes_ += changes;
    if (source.born_count > kBornPerPart || source.deformed_count > kDeformedPerPart || changes == 0 ||
        changes_ > kMaxChanges || source.radius >= kRadiusCodes)
      return RecordResult::kMalformed;
    if (is_first_part_ && source.parent != kNone) {
      if (index(source.parent) >= summary_.vertices) return RecordResult::kMalformed;
      target.parent = store_.vertex(source.parent);
      if (target.parent == kNone) return RecordResult::kIncomplete;
      if (target.parent == u_) return RecordResult::kMalformed;
      ring_.add(target.parent);
    }
    is_first_part_ = false;
    for (std::uint32_t i = 0; i < source.deformed_count; ++i)
      if (const RecordResult result = deform(source.deformed(i), target); result != RecordResult::kDecoded)
        return result;
    if (target.parent == kNone) return RecordResult::kMalformed;
    parent_ = target.parent;
    for (std::uint32_t i = 0; i < source.born_count; ++i)
      if (const RecordResult result = add_born_face(source.born[i], source.born_x[i], at, target);
          result != RecordResult::kDecoded)
        return result;
    return RecordResult::kDecoded;
  }

  /// Computes the position of u from its residuals. Call after the first part was added. False if the position is out
  /// of the bounds.
  [[nodiscard]] bool restore_position(const PositionPredictor::Residuals& residuals,
                                      std::array<float, 3>& position) const noexcept {
    const auto position_of = [this](Vertex v) -> const std::array<float, 3>& { return store_.position(v); };
    return PositionPredictor{summary_, ring_, position_of}.restore_position(residuals, position);
  }

  /// Links the born faces to their neighbours. Call after the last part was added.
  void finish() noexcept { store_.front().link_split(split_); }

  [[nodiscard]] const VertexRing<Vertex>& ring() const noexcept { return ring_; }

 private:
  using Front = std::remove_cvref_t<decltype(std::declval<Store&>().front())>;

  [[nodiscard]] RecordResult deform(DeformedRef ref, Decoded& target) noexcept {
    Front& front = store_.front();
    if (ref.face() == kSwing) {
      if (last_corner_.face == kNone || !front.swing(last_corner_)) return RecordResult::kMalformed;
    } else if (last_corner_.face = store_.face(ref.face()); last_corner_.face == kNone) {
      return RecordResult::kIncomplete;
    }
    const std::array<Vertex, 3> corners = front.corners(last_corner_.face);
    std::uint32_t corner = ref.corner();
    if (target.parent == kNone) {
      if (corner == kCornerOfParent) return RecordResult::kMalformed;
      target.parent = corners[corner];
      ring_.add(target.parent);
    } else {
      corner = 0;
      while (corner < 3 && corners[corner] != target.parent) ++corner;
    }
    if (corner > 2) return RecordResult::kMalformed;
    const Vertex next = corners[(corner + 1) % 3], before = corners[(corner + 2) % 3];
    if (target.parent == u_ || next == u_ || before == u_) return RecordResult::kMalformed;
    ring_.add(next);
    ring_.add(before);
    last_corner_.corner = corner;
    front.set_corner(last_corner_, u_);
    split_.deform(last_corner_);
    target.add_deformed(Decoded::DeformedRef::make(last_corner_.face, corner, ref.is_finest()));
    return RecordResult::kDecoded;
  }

  [[nodiscard]] RecordResult add_born_face(BornRef ref, VertexId named_x, Part at, Decoded& target) noexcept {
    if (index(ref.face()) >= summary_.faces) return RecordResult::kMalformed;
    Vertex x = kNone;
    if (in_ring(named_x)) {
      const std::uint32_t position =
          named_x == ring_position(kLastInRing) ? ring_.size() - 1 : index(named_x) & ~kInRing;
      if (position >= ring_.size()) return RecordResult::kMalformed;
      x = ring_[position];
    } else {
      if (index(named_x) >= summary_.vertices) return RecordResult::kMalformed;
      x = store_.vertex(named_x);
      if (x == kNone) return RecordResult::kIncomplete;
      ring_.add(x);
    }
    if (x == u_ || x == target.parent || store_.face(ref.face()) != kNone) return RecordResult::kMalformed;
    target.born[target.born_count] = ref;
    const Face face = store_.add_born_face(ref.face(), at, target.born_count);
    store_.front().set(face, born_face(ref.order(), u_, target.parent, x));
    split_.add_born_face(face, ref.order());
    target.born_x[target.born_count++] = x;
    return RecordResult::kDecoded;
  }

  Store& store_;
  const ModelSummary& summary_;
  Vertex u_;
  Vertex parent_ = kNone;
  std::uint32_t changes_ = 0;  // born and deformed faces
  bool is_first_part_ = true;
  VertexRing<Vertex> ring_;
  typename Front::Split split_;
  typename Front::CornerRef last_corner_{kNone, 0};  // the last deformed corner
};

}  // namespace tactus::spm
