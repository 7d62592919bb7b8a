#include "host_service/host_config.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/temporary_folder.hpp"
#include "yaml/reader.hpp"

namespace tactus::host_service {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class HostConfigTest : public testing::Test {
 protected:
  std::vector<ObjectConfig> read(const std::string& text) {
    test_support::write_bytes(file_, text);
    return read_config(file_);
  }
  /// Returns the error message for `text`, without the name of the file.
  std::string error_of(const std::string& text) {
    try {
      read(text);
    } catch (const yaml::YamlError& error) {
      const std::string message = error.what();
      EXPECT_THAT(message, StartsWith(file_.string() + ":"));
      return message.substr(file_.string().size() + 1);
    }
    return "none";
  }

  test_support::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "lab.yaml";
};

TEST_F(HostConfigTest, ReadsEveryKey) {
  const std::vector<ObjectConfig> objects = read(R"(objects:
  - name: organ
    model: parts/organ.ply
    position: [1, 2, -3.5]
    rotation: [0, 0, 0.6, 0.8]
    size: 0.2
    material: {stiffness: 800, damping: 2, static_friction: 0.3, dynamic_friction: 0.2}
  - model: /models/terrain.spm
    scale: 0.001
)");
  ASSERT_EQ(objects.size(), 2u);
  EXPECT_EQ(objects[0].name, "organ");
  EXPECT_EQ(objects[0].model, folder_.path() / "parts/organ.ply");
  EXPECT_EQ(objects[0].pose->position, (std::array<double, 3>{1, 2, -3.5}));
  EXPECT_DOUBLE_EQ(objects[0].pose->orientation[2], 0.6);
  EXPECT_EQ(objects[0].size, 0.2);
  EXPECT_EQ(objects[0].scale, std::nullopt);
  EXPECT_EQ(objects[0].material.stiffness, 800);
  EXPECT_EQ(objects[0].material.damping, 2);
  EXPECT_EQ(objects[0].material.static_friction, 0.3);
  EXPECT_EQ(objects[0].material.dynamic_friction, 0.2);
  EXPECT_EQ(objects[1].name, "terrain");
  EXPECT_EQ(objects[1].model, "/models/terrain.spm");
  EXPECT_EQ(objects[1].scale, 0.001);
  EXPECT_FALSE(objects[1].pose);
}

TEST_F(HostConfigTest, ReadsTheBodyOfAMovableObject) {
  const auto objects = read(R"(ground: -0.5
objects:
  - model: crate.spm
    body: {mass: 0.8, friction: 0.6}
  - model: top.spm
    body: {mass: 1, inertia: [0.001, 0.002, 0.003]}
  - model: wall.spm
)");
  ASSERT_TRUE(objects[0].body);
  EXPECT_EQ(objects[0].body->mass, 0.8);
  EXPECT_EQ(objects[0].body->friction, 0.6);
  EXPECT_EQ(objects[0].body->ground, -0.5);
  EXPECT_FALSE(objects[0].body->inertia);
  EXPECT_EQ(objects[1].body->inertia, (std::array<double, 3>{0.001, 0.002, 0.003}));
  EXPECT_FALSE(objects[2].body);
}

TEST_F(HostConfigTest, RefusesAnImpossibleBody) {
  const auto error_with = [&](const std::string& body) {
    return error_of("objects:\n  - model: a.spm\n    body: " + body + "\n");
  };
  EXPECT_THAT(error_with("{friction: 1}"),
              AllOf(StartsWith("3:11: objects[0].body: "), HasSubstr("key 'mass' is missing")));
  EXPECT_THAT(error_with("{mass: 0}"), HasSubstr("body.mass: found '0', expected a number of at least 0.001"));
  EXPECT_THAT(error_with("{mass: 1, friction: -1}"), HasSubstr("friction: found '-1'"));
  EXPECT_THAT(error_with("{mass: 1, inertia: [1, 1]}"), HasSubstr("list of 3 numbers"));
  EXPECT_THAT(error_with("{mass: 1, inertia: [1, 1, 0]}"), HasSubstr("inertia[2]: found '0'"));
  EXPECT_THAT(error_with("{mass: 1, inertia: [1, 1, 3]}"), HasSubstr("larger than the other two"));
  EXPECT_THAT(error_with("{weight: 1}"), HasSubstr("unknown key 'weight'"));
  EXPECT_THAT(error_of("ground: deep\nobjects:\n  - model: a.spm\n"),
              HasSubstr("ground: found 'deep', expected a number"));
}

TEST_F(HostConfigTest, RotatesByRollThenPitchThenYawAboutFixedAxes) {
  const auto object = read("objects: [{model: a.spm, rpy_degrees: [90, 0, 90]}]").at(0);
  // The roll leaves x unchanged, then the yaw rotates x to y. The roll rotates y to z, then the yaw leaves z unchanged.
  const std::array<double, 4> q = object.pose->orientation;
  const auto rotated = [&](double x, double y, double z) {
    // Quaternion x, y, z, w. With v = (x, y, z) and t = 2 q x v, the result is v + w t + q x t.
    const double tx = 2 * (q[1] * z - q[2] * y), ty = 2 * (q[2] * x - q[0] * z), tz = 2 * (q[0] * y - q[1] * x);
    return std::array<double, 3>{x + q[3] * tx + q[1] * tz - q[2] * ty, y + q[3] * ty + q[2] * tx - q[0] * tz,
                                 z + q[3] * tz + q[0] * ty - q[1] * tx};
  };
  EXPECT_NEAR(rotated(1, 0, 0)[1], 1, 1e-12);
  EXPECT_NEAR(rotated(0, 1, 0)[2], 1, 1e-12);
}

TEST_F(HostConfigTest, NamesTheLineOfAnUnknownKey) {
  EXPECT_THAT(error_of("objects:\n  - model: a.spm\n    sise: 3\n"),
              AllOf(StartsWith("3:"), HasSubstr("unknown key 'sise'"), HasSubstr("size")));
  EXPECT_THAT(error_of("objects:\n  - model: a.spm\n    material:\n      stiffnes: 3\n"),
              AllOf(StartsWith("4:"), HasSubstr("'stiffnes'")));
  EXPECT_THAT(error_of("object: []\n"), AllOf(StartsWith("1:"), HasSubstr("'object'")));
}

TEST_F(HostConfigTest, RefusesValuesOutOfRange) {
  const auto error_with = [&](const std::string& line) {
    return error_of("objects:\n  - model: a.spm\n    " + line + "\n");
  };
  EXPECT_THAT(error_with("size: 0"),
              StartsWith("3:11: objects[0].size: found '0', expected a number of at least 1e-06"));
  EXPECT_THAT(error_with("size: big"), HasSubstr("size: found 'big'"));
  EXPECT_THAT(error_with("scale: -1"), HasSubstr("scale: found '-1'"));
  EXPECT_THAT(error_with("scale: .nan"), HasSubstr("scale: found '.nan'"));
  EXPECT_THAT(error_with("position: [1, 2]"), HasSubstr("list of 3 numbers"));
  EXPECT_THAT(error_with("rotation: [0, 0, 0, 2]"), HasSubstr("unit quaternion"));
  EXPECT_THAT(error_with("material: {stiffness: -5}"), HasSubstr("stiffness: found '-5'"));
  EXPECT_THAT(error_with("material: {static_friction: 0.1, dynamic_friction: 0.2}"),
              HasSubstr("above 'static_friction'"));
  EXPECT_THAT(error_with("name: ''"), HasSubstr("1 to 63 bytes"));
  EXPECT_THAT(error_with("scale: 1\n    size: 1"), HasSubstr("expected one of them"));
  EXPECT_THAT(error_of("objects:\n  - name: a\n"), HasSubstr("key 'model' is missing"));
  EXPECT_THAT(error_of("objects: []\n"), HasSubstr("objects: found an empty list, expected a list of objects"));
  EXPECT_THAT(error_of("objects:\n  - model: a.spm\n  - model: b/a.spm\n"), HasSubstr("a second object 'a'"));
}

TEST_F(HostConfigTest, NamesTheLineOfBrokenYamlAndRefusesAMissingFile) {
  EXPECT_THAT(error_of("objects:\n  - {model: a.spm\n"), testing::MatchesRegex("[23]:.*not YAML.*"));
  EXPECT_THROW((void)read_config(folder_.path() / "none.yaml"), yaml::YamlError);
}

}  // namespace
}  // namespace tactus::host_service
