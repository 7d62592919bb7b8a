/// Compares the mesh hashes on the metrics topic with those in the contact log of the same HRTC.
#include "tests/e2e/session_test.hpp"
#include "trace/contact_log.hpp"

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;

class MetricsTest : public SessionTest {};

constexpr char kHold[] = R"(name: hold
duration: 30
users:
  - name: ann
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 3, force: 1}}]
)";

TEST_F(MetricsTest, MetricsContainTheHashOfTheActiveMeshOfEachObject) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--log", path("desk.log")})};
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    const auto desk_meshes = seen.meshes.find("desk");
    return desk_meshes != seen.meshes.end() && !desk_meshes->second.empty();
  })) << desk.output();
  const session::MeshHash before = observer.seen().meshes.at("desk").back();
  EXPECT_EQ(before.object_id, session::id_of("sphere"));
  EXPECT_EQ(before.hash, 0u) << "the base mesh, because nobody touches the object";

  Process users{sim(kHold)};
  EXPECT_EQ(users.wait(40s), 0) << users.output();
  EXPECT_TRUE(exits_with(0, desk));

  std::uint64_t last_logged = 0;
  trace::ContactLogReader log{path("desk.log")};
  for (auto entry = log.next(); entry != trace::ContactLogReader::Entry::kEnd; entry = log.next())
    if (entry == trace::ContactLogReader::Entry::kQuery) last_logged = log.query.mesh_hash;
  ASSERT_NE(last_logged, 0u);
  // Metrics are periodic, so they may lack a mesh of short duration. The last logged mesh was active during ann's hold.
  const std::vector<session::MeshHash> published = observer.seen().meshes.at("desk");
  EXPECT_THAT(published, testing::Each(testing::Field(&session::MeshHash::object_id, session::id_of("sphere"))));
  EXPECT_THAT(published, testing::Contains(testing::Field(&session::MeshHash::hash, last_logged)));
}

}  // namespace
}  // namespace tactus::e2e
