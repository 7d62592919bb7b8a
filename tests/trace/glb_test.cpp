#include "trace/glb.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>

namespace tactus::trace {
namespace {

using nlohmann::json;
using Positions = std::vector<std::array<float, 3>>;
using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// A GLB file, read by the rules of glTF 2.0, section 4.4.
class GlbFile {
 public:
  explicit GlbFile(const std::vector<std::uint8_t>& bytes) : bytes_{bytes} {
    EXPECT_EQ(number(0), 0x46546C67u);
    EXPECT_EQ(number(4), 2u);
    EXPECT_EQ(number(8), bytes.size());
    const std::uint32_t json_bytes = number(12);
    EXPECT_EQ(json_bytes % 4, 0u);
    EXPECT_EQ(number(16), 0x4E4F534Au);
    document_ = json::parse(bytes.begin() + 20, bytes.begin() + 20 + json_bytes);
    const std::size_t next = 20 + json_bytes;
    if (next == bytes.size()) return;
    EXPECT_EQ(number(next), document_["buffers"][0]["byteLength"].get<std::uint32_t>());
    EXPECT_EQ(number(next) % 4, 0u);
    EXPECT_EQ(number(next + 4), 0x004E4942u);
    EXPECT_EQ(next + 8 + number(next), bytes.size());
    binary_ = next + 8;
  }
  [[nodiscard]] const json& document() const { return document_; }

  /// The elements of an accessor, after a check of its type and range.
  template <class Element>
  [[nodiscard]] std::vector<Element> read(std::size_t accessor, std::uint32_t component_type, const char* type,
                                          std::size_t bytes_of_one) const {
    const json& entry = document_["accessors"].at(accessor);
    EXPECT_EQ(entry["componentType"], component_type);
    EXPECT_EQ(entry["type"], type);
    const auto count = entry["count"].get<std::size_t>();
    const json& view = document_["bufferViews"].at(entry["bufferView"].get<std::size_t>());
    EXPECT_EQ(view["byteLength"].get<std::size_t>(), count * bytes_of_one);
    const std::size_t offset = view.value("byteOffset", std::size_t{0});
    EXPECT_EQ(offset % 4, 0u);
    EXPECT_LE(binary_ + offset + count * bytes_of_one, bytes_.size());
    std::vector<Element> elements(count * bytes_of_one / sizeof(Element));
    std::memcpy(elements.data(), bytes_.data() + binary_ + offset, count * bytes_of_one);
    return elements;
  }

 private:
  [[nodiscard]] std::uint32_t number(std::size_t at) const {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value |= std::uint32_t{bytes_.at(at + i)} << (8 * i);
    return value;
  }
  std::vector<std::uint8_t> bytes_;
  json document_;
  std::size_t binary_ = 0;
};

const Positions kPositions{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 0.1f}, {7, 8, -9}};
const Triangles kTriangles{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};

TEST(Glb, HasTheMeshThatWasWritten) {
  const GlbFile file{to_glb(kPositions, kTriangles, {0.5f, 0.25f, 0.125f})};
  const json& primitive = file.document()["meshes"][0]["primitives"][0];

  const std::size_t positions = primitive["attributes"]["POSITION"], indices = primitive["indices"];
  EXPECT_EQ((file.read<std::array<float, 3>>(positions, 5126, "VEC3", 12)), kPositions);
  EXPECT_EQ((file.read<std::array<std::uint32_t, 3>>(indices, 5125, "SCALAR", 4)), kTriangles);
  EXPECT_EQ(file.document()["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"],
            json::array({0.5, 0.25, 0.125, 1}));
}

TEST(Glb, StatesTheExactBoundsOfThePositions) {
  const json position = GlbFile{to_glb(kPositions, kTriangles, {1, 1, 1})}.document()["accessors"][0];
  EXPECT_EQ(position["min"].get<Positions::value_type>(), (std::array<float, 3>{0, 0, -9}));
  EXPECT_EQ(position["max"].get<Positions::value_type>(), (std::array<float, 3>{7, 8, 0.1f}));
}

TEST(Glb, EveryNormalHasUnitLengthAndPointsOutward) {
  const auto normals =
      GlbFile{to_glb(kPositions, kTriangles, {1, 1, 1})}.read<std::array<float, 3>>(1, 5126, "VEC3", 12);
  ASSERT_EQ(normals.size(), kPositions.size());
  for (const auto& [x, y, z] : normals) EXPECT_NEAR(std::hypot(x, y, z), 1, 1e-6);
  EXPECT_LT(normals[0][0] + normals[0][1] + normals[0][2], -1);  // the corner at the origin
  EXPECT_GT(normals[3][2], 0.5);                                 // the top of the flat tetrahedron
}

TEST(Glb, TheNodeTurnsTheUpAxisOfASessionToThatOfGltf) {
  const json rotation = GlbFile{to_glb(kPositions, kTriangles, {1, 1, 1})}.document()["nodes"][0]["rotation"];
  const double x = rotation[0], w = rotation[3];
  // A rotation about x turns +z to (0, -2xw, w^2 - x^2).
  EXPECT_NEAR(-2 * x * w, 1, 1e-15);
  EXPECT_NEAR(w * w - x * x, 0, 1e-15);
}

TEST(Glb, AMeshWithoutTrianglesIsAnEmptyScene) {
  for (const auto& [positions, triangles] :
       {std::pair<Positions, Triangles>{{}, {}}, std::pair<Positions, Triangles>{kPositions, {}}}) {
    const GlbFile file{to_glb(positions, triangles, {1, 1, 1})};
    EXPECT_FALSE(file.document().contains("meshes"));
    EXPECT_EQ(file.document()["asset"]["version"], "2.0");
  }
}

}  // namespace
}  // namespace tactus::trace
