#include "trace/glb.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <string>

namespace tactus::trace {
namespace {

constexpr std::uint32_t kGlbMagic = 0x46546C67, kGlbVersion = 2;             // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4E4F534A, kBinaryChunk = 0x004E4942;  // "JSON", "BIN"
constexpr std::size_t kGlbHeadBytes = 12, kGlbChunkHeadBytes = 8, kGlbAlignment = 4;

void append_number(std::vector<std::uint8_t>& file, std::uint32_t value) {
  for (std::size_t i = 0; i < sizeof value; ++i) file.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

template <class Element>
void append_array(std::vector<std::uint8_t>& file, std::span<const Element> elements) {
  const std::size_t at = file.size();
  file.resize(at + elements.size_bytes());
  // The machine is little-endian, which spm/ requires too.
  if (!elements.empty()) std::memcpy(file.data() + at, elements.data(), elements.size_bytes());
}

std::vector<std::array<float, 3>> vertex_normals(std::span<const std::array<float, 3>> positions,
                                                 std::span<const std::array<std::uint32_t, 3>> triangles) {
  std::vector<Eigen::Vector3d> sums(positions.size(), Eigen::Vector3d::Zero());
  const auto point = [&](std::uint32_t vertex) {
    return Eigen::Vector3d{positions[vertex][0], positions[vertex][1], positions[vertex][2]};
  };
  for (const auto& [a, b, c] : triangles) {
    const Eigen::Vector3d normal = (point(b) - point(a)).cross(point(c) - point(a));  // length: twice the area
    for (const std::uint32_t vertex : {a, b, c}) sums[vertex] += normal;
  }
  std::vector<std::array<float, 3>> normals(positions.size());
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const double length = sums[i].stableNorm();
    // glTF requires unit normals, so a vertex without one gets any.
    const Eigen::Vector3d unit = length > 0 ? Eigen::Vector3d{sums[i] / length} : Eigen::Vector3d::UnitZ();
    normals[i] = {static_cast<float>(unit.x()), static_cast<float>(unit.y()), static_cast<float>(unit.z())};
  }
  return normals;
}

/// Returns three numbers as a JSON array. Nine digits restore a float, and glTF requires the exact bounds.
std::string json_of(const std::array<float, 3>& value) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "[%.9g,%.9g,%.9g]", double{value[0]}, double{value[1]}, double{value[2]});
  return text.data();
}

std::string mesh_json(std::span<const std::array<float, 3>> positions, std::size_t triangles,
                      const std::array<float, 3>& color) {
  std::array<float, 3> low = positions[0], high = positions[0];
  for (const std::array<float, 3>& position : positions)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], position[axis]);
      high[axis] = std::max(high[axis], position[axis]);
    }
  const std::string vertices = std::to_string(positions.size()), indices = std::to_string(3 * triangles);
  const std::string vertex_bytes = std::to_string(12 * positions.size());
  const std::string index_bytes = std::to_string(12 * triangles);
  const std::string bytes = std::to_string(24 * positions.size() + 12 * triangles);
  std::string factor = json_of(color);
  factor.insert(factor.size() - 1, ",1");
  return R"({"asset":{"version":"2.0","generator":"tactus"},"scene":0,"scenes":[{"nodes":[0]}],)"
         // Rotates by -90 degrees about x, so that +z of the session becomes +y.
         R"("nodes":[{"mesh":0,"rotation":[-0.70710678118654757,0,0,0.70710678118654757]}],)"
         R"("meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1},"indices":2,"material":0}]}],)"
         R"("materials":[{"pbrMetallicRoughness":{"baseColorFactor":)" +
         factor + R"(,"metallicFactor":0,"roughnessFactor":1},"doubleSided":true}],)" + R"("accessors":[)" +
         R"({"bufferView":0,"componentType":5126,"count":)" + vertices + R"(,"type":"VEC3","min":)" + json_of(low) +
         R"(,"max":)" + json_of(high) + R"(},{"bufferView":1,"componentType":5126,"count":)" + vertices +
         R"(,"type":"VEC3"},{"bufferView":2,"componentType":5125,"count":)" + indices + R"(,"type":"SCALAR"}],)" +
         R"("bufferViews":[{"buffer":0,"byteLength":)" + vertex_bytes +
         R"(,"target":34962},{"buffer":0,"byteOffset":)" + vertex_bytes + R"(,"byteLength":)" + vertex_bytes +
         R"(,"target":34962},{"buffer":0,"byteOffset":)" + std::to_string(24 * positions.size()) + R"(,"byteLength":)" +
         index_bytes + R"(,"target":34963}],"buffers":[{"byteLength":)" + bytes + "}]}";
}

}  // namespace

std::vector<std::uint8_t> to_glb(std::span<const std::array<float, 3>> positions,
                                 std::span<const std::array<std::uint32_t, 3>> triangles,
                                 const std::array<float, 3>& color) {
  const bool is_empty = positions.empty() || triangles.empty();  // glTF forbids empty accessors
  std::string json = is_empty ? R"({"asset":{"version":"2.0","generator":"tactus"},"scene":0,"scenes":[{}]})"
                              : mesh_json(positions, triangles.size(), color);
  json.resize((json.size() + kGlbAlignment - 1) / kGlbAlignment * kGlbAlignment, ' ');
  const std::size_t binary_bytes = is_empty ? 0 : 24 * positions.size() + 12 * triangles.size();
  const std::size_t bytes =
      kGlbHeadBytes + kGlbChunkHeadBytes + json.size() + (is_empty ? 0 : kGlbChunkHeadBytes + binary_bytes);

  std::vector<std::uint8_t> file;
  file.reserve(bytes);
  for (const std::uint32_t value :
       {kGlbMagic, kGlbVersion, static_cast<std::uint32_t>(bytes), static_cast<std::uint32_t>(json.size()), kJsonChunk})
    append_number(file, value);
  file.insert(file.end(), json.begin(), json.end());
  if (is_empty) return file;
  append_number(file, static_cast<std::uint32_t>(binary_bytes));
  append_number(file, kBinaryChunk);
  const std::vector<std::array<float, 3>> normals = vertex_normals(positions, triangles);
  append_array(file, positions);
  append_array(file, std::span<const std::array<float, 3>>{normals});
  append_array(file, triangles);
  return file;
}

}  // namespace tactus::trace
