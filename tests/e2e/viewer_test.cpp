// A viewer in a session of other programs: what its page receives is what the topics carry.
#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "keys/authority.hpp"
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"
#include "tests/viewer/page_client.hpp"

namespace tactus::e2e {
namespace {

using test_support::PageClient;
using namespace std::chrono_literals;

constexpr char kPress[] = R"(name: press
duration: 60
users:
  - name: ann
    script:
      - approach: {object: "#1", direction: [0, 0, 1], until_force: 1}
      - hold: {force: 1, seconds: 60}
)";

/// The newest state that a page has received.
class Page {
 public:
  explicit Page(std::uint16_t port) : client_{port} {}

  /// Receives messages until `condition()` is true. Returns false if the viewer closes the connection or after 30 s.
  template <class Condition>
  bool until(Condition&& condition) {
    const auto end = std::chrono::steady_clock::now() + 30s;
    while (!condition()) {
      const auto message = client_.receive();
      if (!message || std::chrono::steady_clock::now() > end) return false;
      receive(*message);
    }
    return true;
  }
  void request(const nlohmann::json& request) { client_.send(request.dump()); }
  void stop_forces() { request({{"stop", "a test"}}); }

  nlohmann::json scene = nlohmann::json::object(), figures = nlohmann::json::object();
  std::string notice;
  std::uint32_t faces = 0;  // of the newest mesh frame, as the next
  std::uint64_t mesh_hash = 0;
  bool has_probe = false;
  std::uint32_t status = 0;
  std::array<float, 3> force{};

 private:
  void receive(const PageClient::Message& message) {
    if (message.is_text) {
      nlohmann::json text = nlohmann::json::parse(message.bytes);
      if (text["type"] == "scene")
        scene = std::move(text);
      else if (text["type"] == "figures")
        figures = std::move(text);
      else if (text["type"] == "notice")
        notice = text["text"];
      return;
    }
    const auto read = [&](std::size_t at, auto& value) { std::memcpy(&value, &message.bytes[at], sizeof value); };
    std::uint32_t kind = 0;
    read(0, kind);
    if (kind == 1) {
      read(20, faces);
      return read(24, mesh_hash);
    }
    if (kind != 2) return;
    std::uint32_t probes = 0;
    read(4, probes);
    has_probe = probes > 0;
    if (!has_probe) return;
    read(24 + 8, status);
    read(24 + 16 + 40, force);
  }

  PageClient client_;
};

class ViewerTest : public SessionTest {
 protected:
  ViewerTest() { write("index.html", "<!doctype html>"); }
  /// Starts a viewer and returns its port, once it listens.
  [[nodiscard]] static std::uint16_t port_of(Process& viewer) {
    for (;; std::this_thread::sleep_for(10ms)) {  // the timeout of ctest limits the wait
      const std::string output = viewer.output();
      const std::size_t at = output.find("http://localhost:");
      if (at != std::string::npos && output.find('/', at + 17) != std::string::npos)
        return static_cast<std::uint16_t>(std::stoul(output.substr(at + 17)));
    }
  }
  [[nodiscard]] std::vector<std::string> view(const std::string& name = "view") const {
    return in_session("view", {"--name", name, "--port", "0", "--page", folder_.path().string()});
  }
};

TEST_F(ViewerTest, APageShowsObjectsUsersForcesAndFiguresAndStopsTheForces) {
  Process host_a{host("host-a", models().organ)};
  Process desk{hrtc("desk")};
  Process viewer{view()};
  Observer observer{address("observer")};
  Page page{port_of(viewer)};
  ASSERT_TRUE(page.until([&] { return page.faces > 0; })) << viewer.output();
  const std::uint32_t base_faces = page.faces;
  Process users{sim(kPress)};

  ASSERT_TRUE(page.until(
      [&] { return (page.status & session::kExact) != 0 && page.force[2] > 0.5f && page.faces > base_faces; }));
  ASSERT_TRUE(page.until([&] { return page.scene["users"].size() == 1; }));
  EXPECT_EQ(page.scene["users"][0]["name"], "ann");
  EXPECT_EQ(page.scene["users"][0]["hrtc"], "desk");
  EXPECT_EQ(page.scene["objects"][0]["name"], "organ");
  const auto figure = [&](const char* name) {
    return page.figures.value("/participants/desk"_json_pointer / name, -1.0);
  };
  ASSERT_TRUE(page.until([&] { return figure(session::figures::kRate) > 0; }));
  ASSERT_TRUE(page.until([&] {
    return figure(session::figures::kRegionsReceived) ==
           observer.seen().figure("desk", session::figures::kRegionsReceived);
  }));

  // When the hand rests, the mesh of the HRTC changes no more, and all have the same one.
  const auto published_hash = [&] { return page.figures.value("/meshes/desk/organ"_json_pointer, std::string{}); };
  const auto observed_hash = [&] {
    const Observer::Seen seen = observer.seen();
    const auto meshes = seen.meshes.find("desk");
    return meshes != seen.meshes.end() ? meshes->second.back().hash : 0;
  };
  ASSERT_TRUE(page.until([&] {
    return page.mesh_hash != 0 && published_hash() == std::to_string(page.mesh_hash) &&
           observed_hash() == page.mesh_hash;
  }));

  page.stop_forces();
  ASSERT_TRUE(page.until([&] { return page.scene["stop"]["stopped"] == 1 && page.force == std::array<float, 3>{}; }));
  viewer.signal(SIGTERM);
  EXPECT_TRUE(exits_with(0, viewer));
  EXPECT_TRUE(observer.until([](const Observer::Seen& seen) { return seen.has_left("view"); }));
}

TEST_F(ViewerTest, ThePageTakesAProbeTouchesAndGivesItBack) {
  Process host_a{host("host-a", models().organ)};
  Process desk{hrtc("desk")};
  Process viewer{view()};
  Observer observer{address("observer")};
  Page page{port_of(viewer)};
  ASSERT_TRUE(page.until([&] { return page.faces > 0 && !page.scene["objects"].empty(); })) << viewer.output();
  ASSERT_TRUE(viewer.wait_for_line("HRTC 'desk' joined")) << viewer.output();
  page.request({{"touch", {{"user", "guest"}}}});
  ASSERT_TRUE(page.until([&] { return page.scene["users"].size() == 1; })) << viewer.output();
  EXPECT_EQ(page.scene["users"][0]["name"], "guest");
  EXPECT_EQ(page.scene["users"][0]["hrtc"], "desk");

  const std::array<double, 3> centre = page.scene["objects"][0]["position"];  // the organ contains its origin
  const auto move_to = [&](double height) {
    page.request({{"hand", {{"target", {centre[0], centre[1], centre[2] + height}}, {"grab", false}}}});
  };
  move_to(0.2);
  // Each probe frame, at most every 15 ms, is answered with a target that is 0.5 mm lower.
  double height = 0.2;
  ASSERT_TRUE(page.until([&] {
    move_to(height = std::max(0.0, height - 5e-4));
    return page.force[2] > 0.5f && (page.status & session::kExact) != 0;
  }));
  EXPECT_GT(observer.seen().user("guest").exact, 0u);

  page.request({{"release", true}});
  ASSERT_TRUE(page.until([&] { return page.scene["users"].empty(); }));
  EXPECT_TRUE(observer.until([](const Observer::Seen& seen) { return seen.has_left("view.guest"); }));
}

TEST_F(ViewerTest, WithKeysAPageShowsTheSessionAndBringsOnlyUsersThatTheKeysPermit) {
  const keys::Authority authority = keys::Authority::create(path("lab-keys"));
  const auto with_keys = [&](const std::string& name, keys::Role role, std::vector<std::string> command) {
    keys::NewMember member;
    member.name = name;
    member.role = role;
    if (role == keys::Role::kUser) member.permitted = {"ann"};
    command.insert(command.end(), {"--keys", authority.add(member).string(), "--audit", path(name + ".jsonl")});
    return command;
  };
  Process host_a{with_keys("host-a", keys::Role::kHost, host("host-a", models().organ))};
  Process desk{with_keys("desk", keys::Role::kHrtc, hrtc("desk"))};
  Process viewer{with_keys("view", keys::Role::kUser, view())};
  Page page{port_of(viewer)};
  ASSERT_TRUE(page.until([&] { return page.faces > 0 && !page.scene["objects"].empty(); })) << viewer.output();
  ASSERT_TRUE(viewer.wait_for_line("HRTC 'desk' joined")) << viewer.output();
  page.request({{"touch", {{"user", "guest"}}}});
  ASSERT_TRUE(page.until([&] { return !page.notice.empty(); })) << viewer.output();
  EXPECT_THAT(page.notice, testing::HasSubstr("user 'guest': the keys of user 'view' permit only ann"));
  page.request({{"touch", {{"user", "ann"}}}});
  ASSERT_TRUE(page.until([&] {
    page.request({{"hand", {{"target", {0, 0, 1}}, {"grab", false}}}});
    return page.scene["users"].size() == 1 && page.has_probe;
  })) << viewer.output();
  EXPECT_EQ(page.scene["users"][0]["name"], "ann");
  EXPECT_EQ(page.scene["users"][0]["hrtc"], "desk");
}

TEST_F(ViewerTest, AViewerThatIsKilledDisturbsNobodyAndANewOneShowsTheSession) {
  Process host_a{host("host-a", models().organ)};
  Process desk{hrtc("desk")};
  Process first{view()};
  Process users{sim(kPress)};
  Observer observer{address("observer")};
  {
    Page page{port_of(first)};
    ASSERT_TRUE(page.until([&] { return (page.status & session::kExact) != 0; }));
    first.signal(SIGKILL);
    EXPECT_FALSE(page.until([] { return false; }));
  }
  (void)first.wait();
  Process second{view()};
  Page page{port_of(second)};
  ASSERT_TRUE(page.until([&] { return page.faces > 0 && (page.status & session::kExact) != 0; })) << second.output();
  EXPECT_EQ(observer.seen().user("ann").faults, 0u);
}

TEST_F(ViewerTest, ARecordingShowsMeshAndForceOfItsSessionAndStepsBackToItsBegin) {
  Process recorder{in_session("record", {path("lab.mcap"), "--no-scene"})};
  ASSERT_TRUE(recorder.wait_for_line("recording session"));
  Process host_a{host("host-a", models().organ)};
  Process desk{hrtc("desk")};
  Process users{sim(kPress)};
  Observer observer{address("observer")};
  // The hand rests at last, so that the refined mesh no longer changes. The hash of a base mesh is 0.
  ASSERT_TRUE(observer.until([](const Observer::Seen& seen) {
    const auto meshes = seen.meshes.find("desk");
    if (seen.user("ann").exact < 300 || meshes == seen.meshes.end() || meshes->second.size() < 3) return false;
    const std::vector<session::MeshHash>& hashes = meshes->second;
    return hashes.back().hash != 0 && std::all_of(hashes.end() - 3, hashes.end(),
                                                  [&](const auto& mesh) { return mesh.hash == hashes.back().hash; });
  }));
  recorder.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, recorder));
  const std::uint64_t hash = observer.seen().meshes.at("desk").back().hash;
  for (Process* const each : {&users, &desk, &host_a}) each->signal(SIGKILL);

  Process viewer{program("view", {"--recording", path("lab.mcap"), "--port", "0", "--page", folder_.path().string()})};
  Page page{port_of(viewer)};
  page.request({{"seek", 1000}});  // the end
  ASSERT_TRUE(page.until([&] { return page.mesh_hash == hash && page.force[2] > 0.5f; }))
      << viewer.output() << page.mesh_hash << ", expected " << hash << "; force " << page.force[2];
  ASSERT_TRUE(page.until([&] { return page.scene["users"].size() == 1; }));
  EXPECT_EQ(page.scene["users"][0]["name"], "ann");
  ASSERT_TRUE(page.until(
      [&] { return page.figures.value("/meshes/desk/organ"_json_pointer, std::string{}) == std::to_string(hash); }));

  page.request({{"seek", 0}});
  ASSERT_TRUE(page.until([&] { return !page.has_probe && page.scene["users"].empty(); }));
  page.request({{"play", true}});
  ASSERT_TRUE(page.until([&] { return page.has_probe && page.force[2] > 0.5f; })) << "it plays";
  viewer.signal(SIGTERM);
  EXPECT_TRUE(exits_with(0, viewer));
}

TEST_F(ViewerTest, NamesARecordingThatIsNone) {
  const std::string text = write("notes.mcap", "no recording");
  Process viewer{program("view", {"--recording", text, "--port", "0", "--page", folder_.path().string()})};
  EXPECT_TRUE(exits_with(2, viewer));
  EXPECT_THAT(viewer.output(), testing::HasSubstr("notes.mcap"));
}

TEST_F(ViewerTest, NamesAWrongFolderAndANameThatIsTaken) {
  Process no_page{in_session("view", {"--port", "0", "--page", path("missing")})};
  EXPECT_TRUE(exits_with(2, no_page));
  EXPECT_THAT(no_page.output(), testing::HasSubstr("found no index.html; the package tactus has the page"));
  Process first{view()};
  Observer observer{address("observer")};
  ASSERT_TRUE(observer.until([](const Observer::Seen& seen) { return seen.is_present("view"); }));
  Process second{view()};  // without hosts and HRTCs there is no session time; the newer program leaves
  EXPECT_TRUE(exits_with(2, second));
  EXPECT_THAT(second.output(), testing::HasSubstr("viewer 'view' runs twice"));
}

}  // namespace
}  // namespace tactus::e2e
