#include "spm/codec/record_reader.hpp"

#include <algorithm>
#include <string>

#include "spm/region_data.hpp"

namespace tactus::spm::codec {

RecordReader::RecordReader(const ModelSummary& summary, const RecordTables& tables)
    : summary_{summary}, tables_{tables}, max_radius_{radius_code(summary.deviation)} {}

bool RecordReader::fail(const BitReader& in, RecordId record, const std::string& what) {
  // Past the end and after bits that are no word, every value read is a consequence of that.
  if (check_bits(in, record)) error_ = "record " + std::to_string(index(record)) + ": " + what;
  return false;
}

bool RecordReader::fail(const BitReader& in, RecordId record, const char* what, std::uint64_t found,
                        const char* relation, std::uint64_t expected) {
  return fail(
      in, record,
      std::string{what} + " " + std::to_string(found) + ", expected " + relation + " " + std::to_string(expected));
}

bool RecordReader::check_bits(const BitReader& in, RecordId record) {
  if (in.ok() && code_ok_) return true;
  error_ = "record " + std::to_string(index(record)) +
           (in.ok() ? ": found bits that are no word of a prefix code" : ": its bits are truncated");
  return false;
}

bool RecordReader::get(BitReader& in, RecordId record, FaceId anchor, std::vector<RecordPart>& parts,
                       PositionPredictor::Residuals& residuals) {
  if (index(anchor) >= summary_.faces) return fail(in, record, "first face", index(anchor), "below", summary_.faces);
  const std::size_t at = parts.size();
  RecordPart first{};
  first.parent = kNone;
  first.next = kNone;
  std::uint64_t below = tables_[Field::kRadius].get(in, code_ok_);
  if (below == kRareRadius) below = get_length_prefixed(in);
  if (below > max_radius_)
    return fail(in, record,
                "radius code is " + std::to_string(below - 1) + " below the model's maximum, expected below " +
                    std::to_string(max_radius_));
  first.radius = static_cast<std::uint16_t>(below == 0 ? 0 : max_radius_ + 1 - below);

  const std::uint32_t shape = tables_[field_for(Field::kShape, first.radius)].get(in, code_ok_);
  if (!check_bits(in, record)) return false;
  const bool good = shape == Shape::kUnusual
                        ? get_explicit_faces(in, record, first, anchor, parts)
                        : get_usual_faces(in, record, first, anchor, Shape::from_symbol(shape), parts);
  if (!good) return false;
  recent_.add(anchor, parts[at]);
  const Field along = field_for(Field::kTangentialResidual, first.radius),
              across = field_for(Field::kNormalResidual, first.radius);
  for (std::size_t i = 0; i < 3; ++i) {
    residuals[i] = static_cast<std::uint32_t>(unzigzag(number(in, i < 2 ? along : across)));
  }
  return check_bits(in, record);
}

bool RecordReader::get_usual_faces(BitReader& in, RecordId record, RecordPart& part, FaceId anchor, const Shape& shape,
                                   std::vector<RecordPart>& parts) {
  const std::uint32_t corner = tables_[Field::kCorner].get(in, code_ok_);
  std::uint32_t bits = shape.finest >> shape.born();
  part.add_deformed(DeformedRef::make(anchor, corner, (bits & 1u) != 0));
  for (std::uint32_t i = 1; i < shape.deformed; ++i) {
    part.add_deformed(DeformedRef::make(kSwing, kCornerOfParent, (bits >> i & 1u) != 0));
  }
  const Field first_born = field_for(Field::kBornFirst, part.radius),
              next_born = field_for(Field::kBornNext, part.radius);
  FaceId face = anchor, max = anchor;
  part.born_count = shape.born() & 3u;
  bool at_last = shape.born_at == Shape::kLastEnd;
  for (std::uint32_t i = 0; i < shape.born(); ++i) {
    face = face_after(in, i == 0 ? first_born : next_born, face);
    part.born[i] = BornRef::make(face, at_last ? 1 : 0, (shape.finest >> i & 1u) != 0);
    part.born_x[i] = ring_position(at_last ? kLastInRing : 1);
    at_last = true;
    max = std::max(max, face);
  }
  parts.push_back(part);
  return index(max) < summary_.faces || fail(in, record, "face", index(max), "below", summary_.faces);
}

bool RecordReader::get_explicit_faces(BitReader& in, RecordId record, RecordPart first, FaceId anchor,
                                      std::vector<RecordPart>& parts) {
  const VertexId u{summary_.base_vertices + index(record)};
  FaceId face = anchor;
  bool first_face = true, any_deformed = false;
  std::uint32_t changes = 0;
  const auto next_face = [&](Field field) {
    if (!first_face) face = face_after(in, field, face);
    first_face = false;
    return index(face) < summary_.faces || fail(in, record, "face", index(face), "below", summary_.faces);
  };
  for (bool more = true, is_first_part = true; more; is_first_part = false) {
    const auto head = static_cast<std::uint32_t>(in.get(7));
    more = head >> 6 != 0;
    RecordPart part = first;
    part.born_count = head & 3u;
    part.deformed_count = head >> 2 & 15u;
    if (part.born_count > kBornPerPart) return fail(in, record, "born faces", part.born_count, "at most", kBornPerPart);
    if (part.deformed_count > kDeformedPerPart) {
      return fail(in, record, "deformed corners", part.deformed_count, "at most", kDeformedPerPart);
    }
    if (part.born_count + part.deformed_count == 0) return fail(in, record, "faces in a part", 0, "at least", 1);
    changes += std::uint32_t{part.born_count} + part.deformed_count;
    if (changes > kMaxChanges) return fail(in, record, "born and deformed faces", changes, "at most", kMaxChanges);
    std::uint32_t corner = kCornerOfParent;
    if (is_first_part && part.deformed_count > 0) corner = static_cast<std::uint32_t>(in.get(2));
    if (is_first_part && part.deformed_count > 0 && corner > 2) return fail(in, record, "corner", corner, "at most", 2);
    if (is_first_part && part.deformed_count == 0) {
      const std::uint64_t to_parent = get_length_prefixed(in);
      if (to_parent == 0 || to_parent > index(u))
        return fail(in, record, "distance to the parent vertex", to_parent, "1 to", index(u));
      part.parent = first.parent = VertexId{index(u) - static_cast<std::uint32_t>(to_parent)};
    }
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
      const bool next = any_deformed && in.get(1) != 0;
      if (!next && !next_face(Field::kDeformed)) return false;
      part.set_deformed(i, DeformedRef::make(next ? kSwing : face, corner, in.get(1) != 0));
      corner = kCornerOfParent;
      any_deformed = true;
    }
    for (int i = 0; i < part.born_count; ++i) {
      if (!next_face(field_for(Field::kBornNext, first.radius)) || !get_born(in, record, u, face, part, i))
        return false;
    }
    if (!check_bits(in, record)) return false;
    if (more) part.next = PartIndex{static_cast<std::uint32_t>(parts.size() + 1)};
    parts.push_back(part);
  }
  return true;
}

bool RecordReader::get_born(BitReader& in, RecordId record, VertexId u, FaceId face, RecordPart& part, int i) {
  const auto bits = static_cast<std::uint32_t>(in.get(2));
  part.born[i] = BornRef::make(face, bits >> 1, (bits & 1u) != 0);
  const bool in_ring = in.get(1) != 0;
  const std::uint64_t x = get_length_prefixed(in);
  if (in_ring && x >= kLastInRing)
    return fail(in, record, "position of a third corner in the ring", x, "below", kLastInRing);
  if (!in_ring && (x == 0 || x > index(u))) return fail(in, record, "distance to a third corner", x, "1 to", index(u));
  const auto value = static_cast<std::uint32_t>(x);
  part.born_x[i] = in_ring ? ring_position(value) : VertexId{index(u) - value};
  return true;
}

}  // namespace tactus::spm::codec
