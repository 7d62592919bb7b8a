#include "tools/scene/scene.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "spm/codec/model_codec.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::scene {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using trace::foxglove::LogLevel;
using trace::foxglove::SceneEntity;

constexpr std::uint64_t kSession = 17;
constexpr std::uint64_t kStart = 1'700'000'000'000'000'000;
constexpr std::int64_t kMs = 1'000'000;

Moment at(std::int64_t ms) { return {ms * kMs, kStart + static_cast<std::uint64_t>(ms * kMs)}; }

session::Origin origin_of(const std::string& name, std::uint64_t incarnation = 1) {
  return {kSession, session::id_of(name), incarnation, 0};
}

session::RosterEntry roster_entry(const std::string& name, session::Role role, std::uint64_t heartbeat) {
  session::RosterEntry entry;
  entry.origin = origin_of(name);
  entry.role = role;
  entry.name = name;
  entry.session = "test";
  entry.heartbeat = heartbeat;
  return entry;
}

session::ProbeState probe_state(std::uint32_t sequence) {
  session::ProbeState state;
  state.origin = origin_of("desk");
  state.user_id = session::id_of("ann");
  state.sequence = sequence;
  state.device.position = {0.1, 0.2, 0.3};
  state.proxy = {0.1, 0.2, 0.31};
  state.force = {0, 0, 2};
  state.radius = 0.003;
  return state;
}

class SceneTest : public testing::Test {
 protected:
  [[nodiscard]] session::CatalogueEntry organ(const std::string& host = "museum") const {
    session::CatalogueEntry entry;
    entry.origin = origin_of(host);
    entry.host = host;
    entry.object = "organ";
    entry.object_id = session::id_of("organ");
    entry.summary = model_.summary;
    entry.scale = 0.5;
    entry.pose.position = {1, 2, 3};
    return entry;
  }
  /// The base mesh of the model as chunks of one piece each, of at most `piece_bytes` bytes.
  [[nodiscard]] std::vector<session::BulkChunk> base_chunks(std::uint32_t stream, std::size_t piece_bytes) const {
    const auto base = encoded_.compressed().spans().base;
    const std::size_t count = (base.size() + piece_bytes - 1) / piece_bytes;
    std::vector<session::BulkChunk> chunks(count);
    for (std::size_t i = 0; i < count; ++i) {
      const auto payload = base.subspan(i * piece_bytes, std::min(piece_bytes, base.size() - i * piece_bytes));
      chunks[i].stream = stream;
      chunks[i].sequence = static_cast<std::uint32_t>(i + 1);
      chunks[i].pieces = {{spm::kNone,
                           static_cast<std::uint32_t>(i),
                           static_cast<std::uint32_t>(count),
                           session::checksum_of(base),
                           {payload.begin(), payload.end()}}};
    }
    return chunks;
  }

  spm::OwnedModel model_ = test_support::random_model(5, 400, 3);
  spm::codec::EncodedModel encoded_{model_.model()};
  Scene scene_{origin_of("record")};
};

TEST_F(SceneTest, AnObjectWithoutItsBaseMeshIsTheBoxOfItsBounds) {
  scene_.add(organ(), at(0));
  const Frame frame = scene_.frame(at(1));

  ASSERT_TRUE(frame.objects);
  ASSERT_EQ(frame.objects->entities.size(), 1u);
  const SceneEntity& entity = frame.objects->entities[0];
  EXPECT_EQ(entity.id, "organ");
  EXPECT_EQ(entity.frame_id, "object/organ");
  EXPECT_THAT(entity.models, IsEmpty());
  ASSERT_EQ(entity.cubes.size(), 1u);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double low = model_.summary.bounds_min[axis] * 0.5, high = model_.summary.bounds_max[axis] * 0.5;
    EXPECT_DOUBLE_EQ(entity.cubes[0].pose.position[axis] - entity.cubes[0].size[axis] / 2, low);
    EXPECT_DOUBLE_EQ(entity.cubes[0].pose.position[axis] + entity.cubes[0].size[axis] / 2, high);
  }
  ASSERT_TRUE(frame.transforms);
  ASSERT_EQ(frame.transforms->transforms.size(), 1u);
  EXPECT_EQ(frame.transforms->transforms[0].parent_frame_id, "world");
  EXPECT_EQ(frame.transforms->transforms[0].child_frame_id, "object/organ");
  EXPECT_THAT(frame.transforms->transforms[0].pose.position, ElementsAre(1, 2, 3));
  ASSERT_EQ(frame.events.size(), 1u);
  EXPECT_EQ(frame.events[0].name, "museum");
}

TEST_F(SceneTest, AnObjectWithItsBaseMeshIsAGlb) {
  scene_.add(organ(), at(0));
  (void)scene_.frame(at(0));
  std::vector<session::BulkChunk> chunks = base_chunks(1, 100);
  std::reverse(chunks.begin(), chunks.end());  // the order of arrival does not matter
  for (const session::BulkChunk& chunk : chunks) scene_.add(chunk, at(1));
  EXPECT_FALSE(scene_.frame(at(2)).objects) << "too early after the previous message";
  const Frame frame = scene_.frame(at(1000));

  ASSERT_TRUE(frame.objects);
  const SceneEntity& entity = frame.objects->entities.at(0);
  EXPECT_THAT(entity.cubes, IsEmpty());
  ASSERT_EQ(entity.models.size(), 1u);
  EXPECT_EQ(entity.models[0].media_type, "model/gltf-binary");
  EXPECT_THAT(entity.models[0].scale, ElementsAre(0.5, 0.5, 0.5));
  const std::string glb{entity.models[0].data.begin(), entity.models[0].data.end()};
  EXPECT_THAT(glb, testing::StartsWith("glTF"));
  EXPECT_THAT(glb, HasSubstr("\"count\":" + std::to_string(model_.summary.base_vertices) + ","));
  EXPECT_THAT(glb, HasSubstr("\"count\":" + std::to_string(3 * model_.summary.base_faces) + ","));
}

TEST_F(SceneTest, PiecesOfTwoStreamsAreNotMixed) {
  const auto of_desk = base_chunks(1, 100), of_chair = base_chunks(2, 150);
  scene_.add(organ(), at(0));
  for (std::size_t i = 0; i + 1 < of_desk.size(); ++i) scene_.add(of_desk[i], at(1));
  for (std::size_t i = 1; i < of_chair.size(); ++i) scene_.add(of_chair[i], at(1));
  EXPECT_THAT(scene_.frame(at(2)).objects->entities.at(0).models, IsEmpty());
  scene_.add(of_chair[0], at(1100));
  EXPECT_EQ(scene_.frame(at(1100)).objects->entities.at(0).models.size(), 1u);
}

TEST_F(SceneTest, ADamagedBaseMeshIsDroppedAndALaterOneIsDrawn) {
  scene_.add(organ(), at(0));
  std::vector<session::BulkChunk> chunks = base_chunks(1, 100);
  chunks[1].pieces[0].payload[3] ^= 1;
  for (const session::BulkChunk& chunk : chunks) scene_.add(chunk, at(1));
  EXPECT_THAT(scene_.frame(at(2)).objects->entities.at(0).models, IsEmpty());
  for (const session::BulkChunk& chunk : base_chunks(1, 100)) scene_.add(chunk, at(1100));
  EXPECT_EQ(scene_.frame(at(1100)).objects->entities.at(0).models.size(), 1u);
}

TEST_F(SceneTest, MeshesAboveTheLimitOfBytesAreBoxes) {
  scene_.add(organ(), at(0));
  for (const session::BulkChunk& chunk : base_chunks(1, 100)) scene_.add(chunk, at(0));
  const Frame whole = scene_.frame(at(0));
  const std::size_t glb_bytes = whole.objects->entities.at(0).models.at(0).data.size();

  session::CatalogueEntry second = organ();
  second.object = "second";
  second.object_id = session::id_of("second");
  for (const std::size_t fitting : {0u, 1u, 2u}) {
    Scene scene{origin_of("record"), (fitting + 1) * glb_bytes - 1};
    scene.add(organ(), at(0));
    scene.add(second, at(0));
    for (const session::BulkChunk& chunk : base_chunks(1, 100)) scene.add(chunk, at(0));
    const Frame frame = scene.frame(at(0));
    ASSERT_TRUE(frame.objects);
    std::size_t models = 0, boxes = 0;
    for (const SceneEntity& entity : frame.objects->entities) {
      models += entity.models.size();
      boxes += entity.cubes.size();
    }
    EXPECT_EQ(models, fitting);
    EXPECT_EQ(boxes, 2 - fitting);
  }
}

TEST_F(SceneTest, AnObjectIsDeletedWhenItsLastHostHasWithdrawnIt) {
  session::CatalogueEntry entry = organ("museum");
  scene_.add(entry, at(0));
  scene_.add(organ("annex"), at(0));
  (void)scene_.frame(at(0));
  entry.withdrawn = true;
  scene_.add(entry, at(1000));
  EXPECT_FALSE(scene_.frame(at(1000)).objects);
  entry = organ("annex");
  entry.withdrawn = true;
  scene_.add(entry, at(2000));
  const Frame frame = scene_.frame(at(2000));

  ASSERT_TRUE(frame.objects);
  EXPECT_THAT(frame.objects->entities, IsEmpty());
  ASSERT_EQ(frame.objects->deletions.size(), 1u);
  EXPECT_EQ(frame.objects->deletions[0].id, "organ");
  ASSERT_EQ(frame.events.size(), 1u);
  EXPECT_EQ(frame.events[0].message, "object organ is withdrawn");
}

TEST_F(SceneTest, TheTransformFollowsTheNewestPoseAndIsRepeated) {
  scene_.add(organ(), at(0));
  (void)scene_.frame(at(0));
  EXPECT_FALSE(scene_.frame(at(500)).transforms);
  session::ObjectPose pose;
  pose.origin = origin_of("museum");
  pose.object_id = session::id_of("organ");
  pose.sequence = 1;
  pose.fencing = 1;
  pose.pose.position = {4, 5, 6};
  scene_.add(pose, at(600));
  const Frame frame = scene_.frame(at(600));
  ASSERT_TRUE(frame.transforms);
  EXPECT_THAT(frame.transforms->transforms.at(0).pose.position, ElementsAre(4, 5, 6));
  EXPECT_FALSE(scene_.frame(at(1500)).transforms);
  EXPECT_TRUE(scene_.frame(at(1600)).transforms) << "players interpolate between two transforms";
}

TEST_F(SceneTest, AProbeHasDeviceProxyForceAndTheNameOfItsUser) {
  session::RosterEntry hrtc = roster_entry("desk", session::Role::kHrtc, 1);
  hrtc.served_users = {{"ann", 0}};
  scene_.add(hrtc, at(0));
  scene_.add(probe_state(1), at(0));
  const Frame frame = scene_.frame(at(0));

  ASSERT_TRUE(frame.probes);
  const SceneEntity& entity = frame.probes->entities.at(0);
  EXPECT_EQ(entity.id, "ann");
  EXPECT_EQ(entity.frame_id, "world");
  ASSERT_EQ(entity.spheres.size(), 2u);
  EXPECT_THAT(entity.spheres[0].pose.position, ElementsAre(0.1, 0.2, 0.3));
  EXPECT_THAT(entity.spheres[1].pose.position, ElementsAre(0.1, 0.2, 0.31));
  EXPECT_THAT(entity.spheres[1].size, ElementsAre(0.006, 0.006, 0.006));
  ASSERT_EQ(entity.arrows.size(), 1u);
  const auto& [x, y, z, w] = entity.arrows[0].pose.orientation;
  const Eigen::Vector3d direction = Eigen::Quaterniond{w, x, y, z} * Eigen::Vector3d::UnitX();
  EXPECT_NEAR(direction.z(), 1, 1e-12) << "the arrow points along the force";
  EXPECT_NEAR(entity.arrows[0].shaft_length + entity.arrows[0].head_length, 2 * Scene::kMetresPerNewton, 1e-12);
  ASSERT_EQ(entity.lines.size(), 1u);
  EXPECT_EQ(entity.lines[0].points.size(), 2u);
  ASSERT_EQ(entity.texts.size(), 1u);
  EXPECT_EQ(entity.texts[0].text, "ann");
}

TEST_F(SceneTest, AProbeWithoutForceHasNoArrow) {
  session::ProbeState state = probe_state(1);
  state.force = {};
  scene_.add(state, at(0));
  EXPECT_THAT(scene_.frame(at(0)).probes->entities.at(0).arrows, IsEmpty());
}

TEST_F(SceneTest, AnOlderStateDoesNotReplaceANewerOne) {
  scene_.add(probe_state(2), at(0));
  session::ProbeState older = probe_state(1);
  older.proxy = {9, 9, 9};
  scene_.add(older, at(1));
  EXPECT_THAT(scene_.frame(at(1)).probes->entities.at(0).spheres[1].pose.position, ElementsAre(0.1, 0.2, 0.31));
}

TEST_F(SceneTest, AProbeWithoutNewStatesIsDeletedAfterASecond) {
  scene_.add(probe_state(1), at(0));
  (void)scene_.frame(at(0));
  EXPECT_FALSE(scene_.frame(at(1000)).probes) << "nothing has changed";
  const Frame frame = scene_.frame(at(1001));
  ASSERT_TRUE(frame.probes);
  EXPECT_THAT(frame.probes->entities, IsEmpty());
  ASSERT_EQ(frame.probes->deletions.size(), 1u);
  EXPECT_THAT(frame.probes->deletions[0].id, HasSubstr("user "));
}

TEST_F(SceneTest, RepeatedSamplesAreOneEvent) {
  const session::EmergencyStop stop{origin_of("desk"), 1, "too hot"};
  session::ForceReset reset;
  reset.origin = origin_of("boss");
  reset.number = 1;
  reset.stops = {stop.name()};
  reset.text = "cooled down";
  const session::Control control{origin_of("boss"), 1, session::ControlKind::kMode, "collaborate"};
  const session::SessionEnd end{origin_of("boss"), "closing time"};
  for (int i = 0; i < 3; ++i) scene_.add(stop, at(i));
  for (int i = 0; i < 3; ++i) scene_.add(reset, at(i));
  for (int i = 0; i < 3; ++i) scene_.add(control, at(i));
  for (int i = 0; i < 3; ++i) scene_.add(end, at(i));
  const Frame frame = scene_.frame(at(5));

  std::vector<std::pair<LogLevel, std::string>> events;
  for (const auto& event : frame.events) events.emplace_back(event.level, event.message);
  EXPECT_THAT(events, ElementsAre(std::pair{LogLevel::kError, "emergency stop: too hot"},
                                  std::pair{LogLevel::kWarning, "forces are reset: cooled down"},
                                  std::pair{LogLevel::kInfo, "mode: collaborate"},
                                  std::pair{LogLevel::kInfo, "the session ends: closing time"}));
  EXPECT_THAT(scene_.frame(at(6)).events, IsEmpty());
}

TEST_F(SceneTest, AFaultIsOneEventWithItsReason) {
  session::ProbeState state = probe_state(1);
  state.status = session::kFault | 1u << session::kFaultReasonShift;
  scene_.add(state, at(0));
  state.sequence = 2;
  scene_.add(state, at(1));
  const Frame frame = scene_.frame(at(2));
  ASSERT_EQ(frame.events.size(), 1u);
  EXPECT_EQ(frame.events[0].level, LogLevel::kError);
  EXPECT_THAT(frame.events[0].message, HasSubstr(session::fault_reason(state.status)));
}

TEST_F(SceneTest, ParticipantsThatJoinAndVanishAreEvents) {
  scene_.add(roster_entry("desk", session::Role::kHrtc, 1), at(0));
  const Frame joined = scene_.frame(at(0));
  ASSERT_EQ(joined.events.size(), 1u);
  EXPECT_THAT(joined.events[0].message, HasSubstr("desk"));
  EXPECT_EQ(joined.events[0].name, "desk");
  EXPECT_EQ(joined.events[0].timestamp.sec, kStart / 1'000'000'000);
  std::vector<LogLevel> levels;
  for (int ms = 33; ms <= 600; ms += 33)
    for (const trace::foxglove::Log& event : scene_.frame(at(ms)).events) levels.push_back(event.level);
  ASSERT_THAT(levels, testing::Not(IsEmpty()));
  EXPECT_EQ(levels.back(), LogLevel::kWarning);
}

TEST(BaseMeshes, IncompleteMessagesTakeLimitedMemory) {
  BaseMeshes meshes;
  session::BulkChunk chunk;
  chunk.pieces = {{spm::kNone, 0, 2, 0, std::vector<std::uint8_t>(1400)}};
  // Twice the limit, in messages of which each lacks a piece.
  for (chunk.stream = 1; chunk.stream < 2 * BaseMeshes::kMaxBytes / 1400; ++chunk.stream) {
    EXPECT_FALSE(meshes.add(chunk));
    ASSERT_LE(meshes.bytes(), BaseMeshes::kMaxBytes);
  }
  const spm::OwnedModel model = test_support::random_model(5, 10, 3);
  const spm::codec::EncodedModel encoded{model.model()};
  const auto base = encoded.compressed().spans().base;
  chunk.pieces = {{spm::kNone, 0, 1, session::checksum_of(base), {base.begin(), base.end()}}};
  const std::optional<spm::BaseMesh> decoded = meshes.add(chunk);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->summary.digest, model.summary.digest);
  EXPECT_FALSE(meshes.add(chunk)) << "the model is known";
}

}  // namespace
}  // namespace tactus::scene
