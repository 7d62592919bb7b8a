#include "spm/codec/base_codec.hpp"

#include "spm/position_code.hpp"

namespace tactus::spm::codec {
namespace {

constexpr std::uint8_t kBaseVersion = 8;
constexpr std::size_t kMinVertexBytes = 5;  // in the compact profile
constexpr std::size_t kMinFaceBytes = 4;

void put(ByteWriter& out, const ModelSummary& s) {
  out.raw(s.digest);
  for (const std::uint32_t count :
       {s.vertices, s.faces, s.base_vertices, s.base_faces, s.records, s.parts, s.regions, s.max_level}) {
    out.varint(count);
  }
  out.raw(s.bounds_min);
  out.raw(s.bounds_max);
  out.raw(s.grid.origin);
  out.raw(s.grid.cell_size);
  out.raw(s.metres_per_unit);
  out.raw(s.deviation);
  out.raw(s.position_step);
}

ModelSummary get_summary(ByteReader& in) {
  ModelSummary s{};
  s.digest = in.raw<std::uint64_t>();
  for (std::uint32_t* count :
       {&s.vertices, &s.faces, &s.base_vertices, &s.base_faces, &s.records, &s.parts, &s.regions, &s.max_level}) {
    *count = in.varint32();
  }
  s.bounds_min = in.raw<std::array<float, 3>>();
  s.bounds_max = in.raw<std::array<float, 3>>();
  s.grid.origin = in.raw<std::array<double, 3>>();
  s.grid.cell_size = in.raw<double>();
  s.metres_per_unit = in.raw<double>();
  s.deviation = in.raw<double>();
  s.position_step = in.raw<double>();
  return s;
}

void put_positions(ByteWriter& out, const ModelSummary& s, std::span<const std::array<float, 3>> positions) {
  const PositionCode code{s};
  std::array<std::uint32_t, 3> before{};
  for (std::uint32_t v = 0; v < s.base_vertices; ++v) {
    if (!(s.position_step > 0)) out.raw(positions[v]);
    for (std::size_t axis = 0; s.position_step > 0 && axis < 3; ++axis) {
      const std::uint32_t at = code.encode(axis, double{positions[v][axis]});
      out.varint(zigzag(static_cast<std::int32_t>(at - before[axis])));
      before[axis] = at;
    }
  }
}

/// Reads the base positions. Sums of hostile differences may wrap; violations() checks the result.
void get_positions(ByteReader& in, const ModelSummary& s, std::vector<std::array<float, 3>>& positions) {
  const PositionCode code{s};
  std::array<std::uint32_t, 3> at{};
  for (std::array<float, 3>& position : positions) {
    if (!(s.position_step > 0)) position = in.raw<std::array<float, 3>>();
    for (std::size_t axis = 0; s.position_step > 0 && axis < 3; ++axis) {
      at[axis] += static_cast<std::uint32_t>(unzigzag(in.varint()));
      position[axis] = code.decode(axis, at[axis]);
    }
  }
}

DecodeError truncated(const char* where) { return {std::string{"base mesh: truncated or damaged in its "} + where}; }

DecodeError too_many(const char* what, std::uint32_t count, std::size_t bytes) {
  return {"base mesh: " + std::to_string(count) + " " + what + " do not fit into the remaining " +
          std::to_string(bytes) + " bytes"};
}

}  // namespace

Bytes encode_base(const Model& model, const RecordTables& tables) {
  ByteWriter out;
  out.raw(kBaseVersion);
  put(out, model.summary);
  put_positions(out, model.summary, model.positions);
  for (const std::uint16_t radius : model.base_radii) out.raw(radius);
  std::int64_t face_before = 0;
  std::int64_t corner_before = 0;
  for (const BaseFace& face : model.base_faces) {
    out.varint(zigzag(index(face.face) - face_before) << 1 | face.finest);
    face_before = index(face.face);
    for (const VertexId corner : face.corners) {
      out.varint(zigzag(index(corner) - corner_before));
      corner_before = index(corner);
    }
  }
  BitWriter bits;
  tables.write(bits);
  const Bytes table_bytes = bits.take();
  out.varint(table_bytes.size());
  for (const std::uint8_t byte : table_bytes) out.raw(byte);
  return out.take();
}

Result<DecodedBase> decode_base(std::span<const std::uint8_t> bytes) {
  ByteReader in{bytes};
  const auto version = in.raw<std::uint8_t>();
  if (in.ok() && version != kBaseVersion) {
    return DecodeError{"base mesh: found encoding version " + std::to_string(version) + ", expected " +
                       std::to_string(kBaseVersion)};
  }
  DecodedBase decoded;
  BaseMesh& base = decoded.mesh;
  base.summary = get_summary(in);
  const ModelSummary& s = base.summary;
  if (!in.ok()) return truncated("summary");

  if (in.remaining() / kMinVertexBytes < s.base_vertices) return too_many("vertices", s.base_vertices, in.remaining());
  base.positions.resize(s.base_vertices);
  get_positions(in, s, base.positions);
  base.radii.resize(s.base_vertices);
  for (std::uint16_t& radius : base.radii) radius = in.raw<std::uint16_t>();

  if (in.remaining() / kMinFaceBytes < s.base_faces) return too_many("faces", s.base_faces, in.remaining());
  base.faces.resize(s.base_faces);
  // Sums of hostile differences may wrap; violations() checks the result.
  std::uint64_t face_before = 0;
  std::uint64_t corner_before = 0;
  for (BaseFace& face : base.faces) {
    const std::uint64_t code = in.varint();
    face_before += static_cast<std::uint64_t>(unzigzag(code >> 1));
    face.face = FaceId{static_cast<std::uint32_t>(face_before)};
    face.finest = code & 1u;
    for (VertexId& corner : face.corners) {
      corner_before += static_cast<std::uint64_t>(unzigzag(in.varint()));
      corner = VertexId{static_cast<std::uint32_t>(corner_before)};
    }
  }
  if (!in.ok()) return truncated("faces");

  const std::uint64_t table_bytes = in.varint();
  if (in.remaining() < table_bytes) return truncated("tables");
  BitReader bits{in.remaining_bytes().subspan(0, table_bytes)};
  if (!decoded.tables.read(bits)) return DecodeError{"base mesh: its tables are not prefix codes"};
  in.skip(table_bytes);
  if (!in.ok()) return truncated("tables");
  if (in.remaining() != 0) return DecodeError{"base mesh: " + std::to_string(in.remaining()) + " bytes too many"};

  if (const std::vector<std::string> broken = violations(base); !broken.empty()) {
    return DecodeError{"base mesh: " + broken.front()};
  }
  return decoded;
}

}  // namespace tactus::spm::codec
