#include "trace/foxglove.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/temporary_folder.hpp"
#include "tests/trace/read_mcap.hpp"
#include "trace/cdr.hpp"
#include "trace/idl_schema.hpp"
#include "trace/mcap.hpp"

namespace tactus::trace::foxglove {
namespace {

using nlohmann::json;

/// Returns a message in which every member of every struct has a value of its own.
SceneUpdate filled_update() {
  const Pose pose{{1, 2, 3}, {0.5, -0.5, 0.5, -0.5}};
  const Color color{0.1, 0.2, 0.3, 0.4};
  SceneEntity entity;
  entity.timestamp = Time::from_ns(1'700'000'000'123'456'789);
  entity.frame_id = "world";
  entity.id = "ann";
  entity.frame_locked = false;
  entity.metadata = {{"host", "museum"}, {"faces", "20"}};
  entity.arrows = {{pose, 4, 5, 6, 7, color}};
  entity.cubes = {{pose, {8, 9, 10}, color}};
  entity.spheres = {{pose, {11, 12, 13}, color}, {}};
  entity.lines = {{LineType::kList, pose, 14, false, {{15, 16, 17}, {18, 19, 20}}, color, {color}, {1, 0}}};
  entity.texts = {{pose, false, 21, false, color, "label"}};
  entity.models = {{pose, {22, 23, 24}, color, true, "url", "type", {25, 26, 255}}};
  return {{{{27, 28}, SceneEntityDeletion::Type::kAll, "bob"}}, {entity, {}}};
}

TEST(Foxglove, TheTypesEqualThoseOfFoxglove) {
#ifdef TACTUS_COMPARE_FOXGLOVE_IDL
  EXPECT_EQ(output_of(TACTUS_COMPARE_FOXGLOVE_IDL), "equal\n");
#else
  GTEST_SKIP() << "no schemas of Foxglove: Node.js and the packages of package-lock.json are needed";
#endif
}

TEST(Foxglove, TheReferenceReaderFindsEveryFieldOfEveryMessage) {
  if (const std::string reason = missing_mcap_reader(); !reason.empty()) GTEST_SKIP() << reason;
  const test_support::TemporaryFolder folder;
  const std::string file = (folder.path() / "scene.mcap").string();
  {
    McapWriter mcap{file, "test"};
    const auto write = [&](const char* type, const auto& message) {
      CdrWriter encoded;
      encoded(message);
      mcap.write(mcap.add_channel(mcap.add_schema(std::string{"foxglove::"} + type, "omgidl", idl()), type, "cdr"), 1,
                 1, 1, encoded.bytes());
    };
    write("SceneUpdate", filled_update());
    write("FrameTransforms", FrameTransforms{{{{1, 2}, "world", "object/a", {{3, 4, 5}, {0, 0, 0, 1}}}}});
    write("Log", Log{{1, 2}, LogLevel::kError, "text", "desk", "file", 6});
  }
  const json all = json::parse(read_mcap("decoded '" + file + "'"));

  const json pose = json::parse(
      R"({"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"x": 0.5, "y": -0.5, "z": 0.5, "w": -0.5}})");
  const json color = json::parse(R"({"r": 0.1, "g": 0.2, "b": 0.3, "a": 0.4})");
  const json& update = all["SceneUpdate"]["last"];
  EXPECT_EQ(update["deletions"], json::parse(R"([{"timestamp": {"sec": 27, "nsec": 28}, "type": 1, "id": "bob"}])"));
  ASSERT_EQ(update["entities"].size(), 2u);
  const json& entity = update["entities"][0];
  EXPECT_EQ(entity["timestamp"], json::parse(R"({"sec": 1700000000, "nsec": 123456789})"));
  EXPECT_EQ(entity["frame_id"], "world");
  EXPECT_EQ(entity["id"], "ann");
  EXPECT_EQ(entity["lifetime"], json::parse(R"({"sec": 0, "nsec": 0})"));
  EXPECT_EQ(entity["frame_locked"], false);
  EXPECT_EQ(entity["metadata"],
            json::parse(R"([{"key": "host", "value": "museum"}, {"key": "faces", "value": "20"}])"));
  json arrow = json::parse(R"({"shaft_length": 4, "shaft_diameter": 5, "head_length": 6, "head_diameter": 7})");
  arrow["pose"] = pose, arrow["color"] = color;
  EXPECT_EQ(entity["arrows"], json::array({arrow}));
  json cube = json::parse(R"({"size": {"x": 8, "y": 9, "z": 10}})");
  cube["pose"] = pose, cube["color"] = color;
  EXPECT_EQ(entity["cubes"], json::array({cube}));
  ASSERT_EQ(entity["spheres"].size(), 2u);
  EXPECT_EQ(entity["spheres"][0]["size"], json::parse(R"({"x": 11, "y": 12, "z": 13})"));
  EXPECT_EQ(entity["cylinders"], json::array());
  json line = json::parse(R"({"type": 2, "thickness": 14, "scale_invariant": false, "indices": [1, 0],
                              "points": [{"x": 15, "y": 16, "z": 17}, {"x": 18, "y": 19, "z": 20}]})");
  line["pose"] = pose, line["color"] = color, line["colors"] = {color};
  EXPECT_EQ(entity["lines"], json::array({line}));
  EXPECT_EQ(entity["triangles"], json::array());
  json text = json::parse(R"({"billboard": false, "font_size": 21, "scale_invariant": false, "text": "label"})");
  text["pose"] = pose, text["color"] = color;
  EXPECT_EQ(entity["texts"], json::array({text}));
  json model = json::parse(R"({"scale": {"x": 22, "y": 23, "z": 24}, "override_color": true, "url": "url",
                               "media_type": "type", "data": [25, 26, 255]})");
  model["pose"] = pose, model["color"] = color;
  EXPECT_EQ(entity["models"], json::array({model}));

  EXPECT_EQ(all["FrameTransforms"]["last"], json::parse(R"({"transforms": [{
      "timestamp": {"sec": 1, "nsec": 2}, "parent_frame_id": "world", "child_frame_id": "object/a",
      "translation": {"x": 3, "y": 4, "z": 5}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}]})"));
  EXPECT_EQ(all["Log"]["last"], json::parse(R"({"timestamp": {"sec": 1, "nsec": 2}, "level": 4, "message": "text",
                                                "name": "desk", "file": "file", "line": 6})"));
}

TEST(Foxglove, OurReaderDecodesTheMessagesByTheIdl) {
  CdrWriter encoded;
  encoded(filled_update());
  const std::vector<std::string> cells = IdlSchema{idl()}.values("foxglove::SceneUpdate", encoded.bytes());
  ASSERT_EQ(cells.size(), 2u);
  EXPECT_THAT(cells[1], testing::HasSubstr("label"));
}

}  // namespace
}  // namespace tactus::trace::foxglove
