#include "spm/codec/region_codec.hpp"

namespace tactus::spm::codec {
namespace {

constexpr std::uint8_t kAnotherPart = 1u << 6;
/// Head, u - t, radius, position.
constexpr std::size_t kMinRecordBytes = 3 + sizeof(std::array<float, 3>);
constexpr std::size_t kMinRunBytes = 2;

void put_runs(ByteWriter& out, Span<const Run> runs) {
  out.varint(runs.size());
  std::uint32_t end = 0;
  for (const Run& run : runs) {
    out.varint(run.first - end);
    out.varint(run.count);
    end = run.first + run.count;
  }
}

void put_faces(ByteWriter& out, const RecordPart& part, std::uint32_t u, bool first_part, std::int64_t& face_before) {
  for (int i = 0; i < part.born_count; ++i) {
    const BornRef ref = part.born[i];
    const bool whole = first_part && i == 0;
    out.varint((whole ? ref.face() : zigzag(ref.face() - face_before)) << 4 | (ref.bits & 15u));
    out.varint(u - part.born_x[i]);
    face_before = ref.face();
  }
  for (int i = 0; i < part.deformed_count; ++i) {
    const DeformedRef ref = part.deformed[i];
    const bool whole = first_part && part.born_count == 0 && i == 0;
    out.varint((whole ? ref.face() : zigzag(ref.face() - face_before)) << 3 | (ref.bits & 7u));
    face_before = ref.face();
  }
}

void put_record(ByteWriter& out, const Model& model, std::uint32_t record) {
  const std::uint32_t u = model.summary.base_vertices + record;
  std::int64_t face_before = 0;
  for (std::uint32_t at = record; at != kNone; at = model.parts[at].next) {
    const RecordPart& part = model.parts[at];
    const int more = part.next == kNone ? 0 : kAnotherPart;
    out.raw(static_cast<std::uint8_t>(part.born_count | part.deformed_count << 2 | more));
    if (at == record) {
      out.varint(u - part.parent);
      out.varint(part.radius);
      out.raw(model.positions[u]);
    }
    put_faces(out, part, u, at == record, face_before);
  }
}

std::string text(std::uint64_t value) { return std::to_string(value); }

/// Decodes one message; the first thing found wrong stays in `error`.
class RegionDecoder {
 public:
  RegionDecoder(Span<const std::uint8_t> bytes, const ModelSummary& summary) : in_{bytes}, summary_{summary} {}

  Result<RegionData> decode() {
    const std::uint32_t region = in_.varint32();
    if (in_.ok() && region >= summary_.regions) return refuse("id", region, "below", summary_.regions);
    data_.region = RegionId{region};
    std::uint32_t listed = 0;
    std::uint32_t sent = 0;
    if (!get_runs(data_.list, listed) || !get_runs(data_.sent, sent)) return DecodeError{error_};
    if (!sent_is_in_list()) return DecodeError{error_};
    if (in_.left() / kMinRecordBytes < sent) return refuse("records", sent, "in bytes", in_.left());
    data_.positions.reserve(sent);
    data_.parts.reserve(sent);
    for (const Run& run : data_.sent) {
      for (std::uint32_t r = run.first; r != run.first + run.count; ++r) {
        if (!get_record(r)) return DecodeError{error_};
      }
    }
    if (!in_.ok()) return DecodeError{where() + "the bytes end or go wrong in its runs"};
    if (in_.left() != 0) return refuse("bytes too many", in_.left(), "expected", 0);
    return std::move(data_);
  }

 private:
  [[nodiscard]] std::string where() const { return "region " + text(index(data_.region)) + ": "; }
  DecodeError refuse(const char* what, std::uint64_t found, const char* relation, std::uint64_t expected) const {
    return {where() + what + " " + text(found) + ", " + relation + " " + text(expected)};
  }
  bool fail(std::uint32_t record, const char* what, std::uint64_t found, const char* relation, std::uint64_t expected) {
    error_ = where() + "record " + text(record) + ": " + what + " " + text(found) + ", expected " + relation + " " +
             text(expected);
    return false;
  }

  bool get_runs(std::vector<Run>& runs, std::uint32_t& records) {
    const std::uint32_t count = in_.varint32();
    if (in_.left() / kMinRunBytes < count) {
      error_ = refuse("runs", count, "in bytes", in_.left()).text;
      return false;
    }
    runs.resize(count);
    std::uint64_t end = 0;
    for (Run& run : runs) {
      const std::uint32_t gap = in_.varint32();
      run.count = in_.varint32();
      const std::uint64_t first = end + gap;
      if (run.count == 0 || (gap == 0 && end != 0) || first + run.count > summary_.records) {
        error_ = where() + "run of " + text(run.count) + " records from " + text(first) + " after one that ends at " +
                 text(end) + ", expected a gap and no record from " + text(summary_.records);
        return false;
      }
      run.first = static_cast<std::uint32_t>(first);
      end = first + run.count;
      records += run.count;
    }
    return true;
  }

  bool sent_is_in_list() {
    std::size_t i = 0;
    for (const Run& run : data_.sent) {
      const auto end = [](const Run& r) { return r.first + r.count; };
      while (i < data_.list.size() && end(data_.list[i]) <= run.first) ++i;
      if (i == data_.list.size() || run.first < data_.list[i].first || end(run) > end(data_.list[i])) {
        error_ = where() + "sent run of " + text(run.count) + " records from " + text(run.first) +
                 " is not within one run of its list";
        return false;
      }
    }
    return true;
  }

  bool get_record(std::uint32_t record) {
    const std::uint32_t u = summary_.base_vertices + record;
    RecordPart first{};
    const auto head = in_.raw<std::uint8_t>();
    const std::uint64_t to_parent = in_.varint();
    const std::uint64_t radius = in_.varint();
    const auto position = in_.raw<std::array<float, 3>>();
    if (!in_.ok()) return fail(record, "bytes left", 0, "at least", kMinRecordBytes);
    if (to_parent == 0 || to_parent > u) return fail(record, "distance to its parent", to_parent, "1 to", u);
    if (radius >= kRadiusCodes || radius_of(static_cast<std::uint16_t>(radius)) > summary_.deviation) {
      return fail(record, "radius code", radius, "at most", radius_code(summary_.deviation));
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      // Written so that a NaN fails.
      if (!(position[axis] >= summary_.bounds_min[axis] && position[axis] <= summary_.bounds_max[axis])) {
        return fail(record, "coordinate outside the bounds, axis", axis, "none of", 3);
      }
    }
    first.parent = u - static_cast<std::uint32_t>(to_parent);
    first.radius = static_cast<std::uint16_t>(radius);
    data_.positions.push_back(position);
    return get_parts(record, head, first);
  }

  bool get_parts(std::uint32_t record, std::uint8_t head, const RecordPart& first) {
    bool any_face = false;
    std::int64_t face = 0;
    for (;;) {
      data_.parts.push_back(first);
      RecordPart& part = data_.parts.back();
      part.born_count = head & 3u;
      part.deformed_count = head >> 2 & 15u;
      if (part.born_count > kBornPerPart) return fail(record, "born faces", part.born_count, "at most", kBornPerPart);
      if (part.deformed_count > kDeformedPerPart) {
        return fail(record, "deformed corners", part.deformed_count, "at most", kDeformedPerPart);
      }
      if (head > 2 * kAnotherPart - 1) return fail(record, "head", head, "below", 2 * kAnotherPart);
      if (!get_faces(record, part, any_face, face)) return false;
      if ((head & kAnotherPart) == 0) {
        part.next = kNone;
        return true;
      }
      if (part.born_count + part.deformed_count == 0)
        return fail(record, "faces in a part before the last", 0, "over", 0);
      part.next = static_cast<std::uint32_t>(data_.parts.size());
      if (data_.parts.size() >= summary_.parts) {
        return fail(record, "parts up to here", data_.parts.size() + 1, "at most", summary_.parts);
      }
      if (in_.left() == 0) return fail(record, "bytes left for its next part", 0, "at least", 1);
      head = in_.raw<std::uint8_t>();
    }
  }

  /// The record's next face: whole at first, then the difference to the one before.
  bool next_face(std::uint64_t code, bool& any_face, std::int64_t& face) const {
    face = any_face ? face + unzigzag(code) : static_cast<std::int64_t>(code);
    any_face = true;
    return face >= 0 && face < static_cast<std::int64_t>(summary_.faces);
  }

  bool get_faces(std::uint32_t record, RecordPart& part, bool& any_face, std::int64_t& face) {
    const std::uint32_t u = summary_.base_vertices + record;
    for (int i = 0; i < part.born_count; ++i) {
      const std::uint64_t code = in_.varint();
      const std::uint64_t to_x = in_.varint();
      const std::uint32_t order = code >> 1 & 7u;
      if (!next_face(code >> 4, any_face, face)) {
        return fail(record, "born face", static_cast<std::uint64_t>(face), "below", summary_.faces);
      }
      if (order > 5) return fail(record, "corner order", order, "at most", 5);
      if (to_x == 0 || to_x > u || to_x == u - part.parent) {
        return fail(record, "distance to a third corner", to_x, "other than its parent's and 1 to", u);
      }
      part.born[i] = BornRef::make(static_cast<std::uint32_t>(face), order, (code & 1u) != 0);
      part.born_x[i] = u - static_cast<std::uint32_t>(to_x);
    }
    for (int i = 0; i < part.deformed_count; ++i) {
      const std::uint64_t code = in_.varint();
      const std::uint32_t corner = code >> 1 & 3u;
      if (!next_face(code >> 3, any_face, face)) {
        return fail(record, "deformed face", static_cast<std::uint64_t>(face), "below", summary_.faces);
      }
      if (corner > 2) return fail(record, "corner", corner, "at most", 2);
      part.deformed[i] = DeformedRef::make(static_cast<std::uint32_t>(face), corner, (code & 1u) != 0);
    }
    return in_.ok() || fail(record, "bytes left for its faces", 0, "at least", 1);
  }

  ByteReader in_;
  const ModelSummary& summary_;
  RegionData data_;
  std::string error_;
};

}  // namespace

Bytes encode_region(const Model& model, RegionId region, Span<const Run> missing) {
  ByteWriter out;
  out.varint(index(region));
  put_runs(out, model.runs_of(region));
  put_runs(out, missing);
  for (const Run& run : missing) {
    for (std::uint32_t r = run.first; r != run.first + run.count; ++r) put_record(out, model, r);
  }
  return out.take();
}

Result<RegionData> decode_region(Span<const std::uint8_t> bytes, const ModelSummary& summary) {
  return RegionDecoder{bytes, summary}.decode();
}

}  // namespace tactus::spm::codec
