#include "viewer/viewer_core.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <set>

#include "spm/model.hpp"
#include "tests/support/hrtc_model.hpp"
#include "tests/viewer/viewer_session.hpp"
#include "viewer/page_feed.hpp"

namespace tactus::viewer {
namespace {

using spm::Vec3d;

constexpr double kRadius = 0.05;  // m, of the sphere

/// Corners of a face, the smallest first, so that equal faces compare equal.
std::array<std::array<float, 3>, 3> face_of(std::array<std::array<float, 3>, 3> corners) {
  std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
  return corners;
}

class ViewerCoreTest : public ViewerSession {
 protected:
  [[nodiscard]] double metres(double file_units) const { return file_units * object().entry.scale; }

  /// Faces of the finest mesh with a corner within `distance` m of `centre`.
  [[nodiscard]] std::set<std::array<std::array<float, 3>, 3>> finest_faces_near(const Vec3d& centre,
                                                                                double distance) const {
    std::set<std::array<std::array<float, 3>, 3>> faces;
    for (const auto& corners : spm::finest_faces(model_)) {
      std::array<std::array<float, 3>, 3> face;
      bool is_near = false;
      for (std::size_t i = 0; i < 3; ++i) {
        face[i] = model_.positions[corners[i]];
        is_near =
            is_near || (Vec3d{face[i][0], face[i][1], face[i][2]} * object().entry.scale - centre).norm() < distance;
      }
      if (is_near) faces.insert(face_of(face));
    }
    return faces;
  }

  [[nodiscard]] std::set<std::array<std::array<float, 3>, 3>> shown_faces() const {
    std::set<std::array<std::array<float, 3>, 3>> faces;
    for (const ShownMesh::Face& row : object().mesh.rows()) {
      const auto& c = row.corners;
      faces.insert(face_of({{{c[0], c[1], c[2]}, {c[3], c[4], c[5]}, {c[6], c[7], c[8]}}}));
    }
    return faces;
  }
};

TEST_F(ViewerCoreTest, TheBaseMeshIsShownWithoutProbes) {
  run(500 * kMs);

  EXPECT_EQ(object().mesh.faces(), model_.summary.base_faces);
  EXPECT_EQ(object().mesh.mesh_hash(), 0u);
}

TEST_F(ViewerCoreTest, FacesNearAProbeAreThoseOfTheFinestMesh) {
  const Vec3d at{kRadius, 0, 0};
  place_probe(at);
  run(1000 * kMs);

  const auto expected = finest_faces_near(at, 0.003), shown = shown_faces();
  ASSERT_GT(expected.size(), 20u);
  for (const auto& face : expected) EXPECT_EQ(shown.count(face), 1u);
  EXPECT_LT(object().mesh.faces(), model_.summary.faces) << "elsewhere the mesh is coarse";
}

TEST_F(ViewerCoreTest, ShownFacesAreReadAgainAsSoonAsSomebodyWatches) {
  viewer_.set_watched(false);
  const Vec3d at{kRadius, 0, 0};
  place_probe(at);
  run(1000 * kMs);
  EXPECT_EQ(object().mesh.change_number(), 0u);

  viewer_.set_watched(true);
  run(2 * kMs);
  const auto expected = finest_faces_near(at, 0.003), shown = shown_faces();
  for (const auto& face : expected) EXPECT_EQ(shown.count(face), 1u);
}

TEST_F(ViewerCoreTest, AProbeThatMovesOverTheWholeObjectFindsMemoryInTheFullPool) {
  run(500 * kMs);
  for (int step = 0; step < 200; ++step) {
    const double angle = 0.1 * step, height = 0.9 * std::sin(0.37 * step);
    const double around = std::sqrt(1 - height * height);
    place_probe(kRadius * Vec3d{around * std::cos(angle), around * std::sin(angle), height});
    run(50 * kMs);
  }
  EXPECT_GT(viewer_.loader().figures().regions_coarsened, 10u);
  const Vec3d at{kRadius, 0, 0};
  place_probe(at);
  run(1000 * kMs);

  const auto expected = finest_faces_near(at, 0.003), shown = shown_faces();
  for (const auto& face : expected) ASSERT_EQ(shown.count(face), 1u);
}

TEST_F(ViewerCoreTest, APageThatTakesAMessageEveryTwentyMillisecondsGetsAllKinds) {
  PageFeed page{viewer_};
  std::map<std::string, int> received;
  double angle = 0;
  std::int64_t next_ns = now_ns_;
  after_step = [&] {
    place_probe(kRadius * Vec3d{std::cos(angle), std::sin(angle), 0});
    angle += 1e-3;
    if (now_ns_ < next_ns) return;
    next_ns = now_ns_ + 20 * kMs;
    session::Metrics metrics;
    metrics.origin = {kSession, kHost, 1, now_ns_};
    viewer_.on_metrics(metrics, now_ns_);
    if (const auto message = page.next(now_ns_))
      ++received[message->is_text ? nlohmann::json::parse(message->bytes)["type"].get<std::string>()
                                  : std::to_string(message->bytes[0])];
  };
  run(4000 * kMs);
  for (const char* const kind : {"figures", "1", "2", "3"}) EXPECT_GE(received[kind], 5) << kind;
}

TEST_F(ViewerCoreTest, ThePagesObjectIsTheViewersAfterEveryFrameAndAfterSkippedOnes) {
  /// What a page holds: the rows of the mesh frames that it has received.
  struct Page {
    explicit Page(const ViewerCore& core) : feed{core} {}
    void receive(std::int64_t now_ns) {
      while (const auto message = feed.next(now_ns)) {
        if (message->is_text) continue;
        const auto number = [&](std::size_t at) {
          std::uint32_t value;
          std::memcpy(&value, &message->bytes[at], sizeof value);
          return value;
        };
        if (number(0) != static_cast<std::uint32_t>(FrameKind::kMesh)) continue;
        ++frames;
        if ((number(8) & 1u) != 0) rows.clear();
        const std::uint32_t count = number(16);
        rows.resize(number(12));
        for (std::uint32_t i = 0; i < count; ++i) {
          const std::uint32_t row = number(32 + 4 * i);
          ShownMesh::Face& face = rows[row & 0x7fffffffu];
          face.finest = row >> 31 != 0;
          std::memcpy(face.corners.data(), &message->bytes[32 + 4 * count + 36 * i], 36);
        }
      }
    }
    PageFeed feed;
    std::vector<ShownMesh::Face> rows;
    int frames = 0;
  } eager_page{viewer_}, slow_page{viewer_};
  after_step = [&] { eager_page.receive(now_ns_); };
  run(500 * kMs);
  slow_page.receive(now_ns_);
  for (int step = 0; step < 60; ++step) {
    place_probe(kRadius * Vec3d{std::cos(0.1 * step), std::sin(0.1 * step), 0});
    run(50 * kMs);
  }
  run(200 * kMs);
  slow_page.receive(now_ns_);

  EXPECT_EQ(eager_page.rows, object().mesh.rows());
  EXPECT_EQ(slow_page.rows, object().mesh.rows());
  EXPECT_EQ(slow_page.frames, 2) << "a page that takes no messages gets all changes in one frame";
  EXPECT_GT(eager_page.frames, 10);
}

TEST_F(ViewerCoreTest, AnObjectIsGoneAfterItsHostHasWithdrawnIt) {
  run(500 * kMs);
  ASSERT_EQ(viewer_.objects().size(), 1u);
  for (session::CatalogueEntry entry : host_.catalogue()) {
    entry.origin = {kSession, kHost, 1, now_ns_};
    entry.withdrawn = true;
    viewer_.on_catalogue(entry);
  }
  run(100 * kMs);

  EXPECT_TRUE(viewer_.objects().empty());
  EXPECT_EQ(viewer_.loader().figures().slots_used, 0u) << "its memory is free";
}

TEST_F(ViewerCoreTest, AnOvertakenStateIsIgnoredAndASilentProbeIsGoneAfterASecond) {
  place_probe({0.1, 0, 0});
  run(10 * kMs);
  session::ProbeState old = *state_;
  old.sequence -= 5;
  old.device.position[0] = 5;
  viewer_.on_probe_state(old, now_ns_);
  EXPECT_EQ(viewer_.probes().begin()->second.state.device.position[0], 0.1);

  state_.reset();
  run(900 * kMs);
  EXPECT_EQ(viewer_.probes().size(), 1u);
  run(200 * kMs);
  EXPECT_TRUE(viewer_.probes().empty());
}

TEST_F(ViewerCoreTest, AStopIsRepeatedUntilTheHostHasAcknowledgedIt) {
  run(300 * kMs);
  viewer_.stop_forces("a test", now_ns_);
  run(10 * kMs);
  EXPECT_TRUE(viewer_.stop_progress().is_requested);
  run(2000 * kMs);

  EXPECT_GE(stops_sent_, 50);
  EXPECT_FALSE(viewer_.stop_progress().is_requested);
  const int sent = stops_sent_;
  run(500 * kMs);
  EXPECT_EQ(stops_sent_, sent);
}

TEST_F(ViewerCoreTest, AStopIsRepeatedForAnHrtcThatIsGoneUntilAReset) {
  session::RosterEntry hrtc;
  hrtc.origin = {kSession, kHrtc, 1, 0};
  hrtc.role = session::Role::kHrtc;
  hrtc.name = "desk";
  viewer_.on_roster(hrtc, now_ns_);
  viewer_.stop_forces("a test", now_ns_);
  run(2000 * kMs);
  EXPECT_EQ(viewer_.stop_progress().hrtcs, 0u) << "it is gone";
  EXPECT_THAT(viewer_.stop_progress().missing, testing::ElementsAre("desk")) << "it may still exert forces";
  EXPECT_TRUE(viewer_.stop_progress().is_requested);
  const int sent = stops_sent_;
  run(500 * kMs);
  EXPECT_GT(stops_sent_, sent);

  session::ForceReset reset;
  reset.origin = {kSession, 50, 1, 0};
  reset.number = 1;
  reset.stops = {{kHrtc, 1, 1}};
  viewer_.on_reset(reset, now_ns_);
  run(50 * kMs);
  EXPECT_TRUE(viewer_.stop_progress().is_requested) << "the reset names another stop";
  reset.number = 2;
  reset.stops = {{kViewer, 1, 1}};
  viewer_.on_reset(reset, now_ns_);
  run(50 * kMs);
  EXPECT_FALSE(viewer_.stop_progress().is_requested);
}

TEST_F(ViewerCoreTest, TheSceneFollowsAStopAndAResetOfAnHrtcWithoutAnotherEvent) {
  session::RosterEntry hrtc;
  hrtc.origin = {kSession, kHrtc, 1, 0};
  hrtc.role = session::Role::kHrtc;
  hrtc.name = "desk";
  const auto beat = [&] {
    ++hrtc.heartbeat;
    viewer_.on_roster(hrtc, now_ns_);
    run(10 * kMs);
  };
  beat();
  EXPECT_EQ(viewer_.stop_progress().hrtcs, 1u);
  std::uint32_t before = viewer_.scene_number();
  hrtc.stops = {{50, 1, 1, 0, 0}};
  beat();
  EXPECT_EQ(viewer_.stop_progress().stopped, 1u);
  EXPECT_GT(viewer_.scene_number(), before);
  before = viewer_.scene_number();
  hrtc.stops = {{50, 1, 1, 1, 0}};
  beat();
  EXPECT_EQ(viewer_.stop_progress().stopped, 0u);
  EXPECT_GT(viewer_.scene_number(), before);
}

TEST_F(ViewerCoreTest, ARepeatedStopIsOneEvent) {
  run(300 * kMs);
  session::EmergencyStop stop{{kSession, 50, 1, 0}, 1, "needle bent"}, other{{kSession, 51, 1, 0}, 1, "door open"};
  for (int i = 0; i < 50; ++i) {
    viewer_.on_stop(stop, now_ns_);
    viewer_.on_stop(other, now_ns_);
  }
  EXPECT_EQ(std::count_if(viewer_.events().begin(), viewer_.events().end(),
                          [](const Event& event) { return event.text.find("emergency stop") == 0; }),
            2);
}

TEST_F(ViewerCoreTest, APageThatFloodsMakesFewLinesAndReplacesNoOtherEvents) {
  int lines = 0;
  viewer_.on_event = [&](const std::string&) { ++lines; };
  viewer_.add_event("HRTC 'desk' joined", now_ns_);
  for (int touch = 0; touch < 10'000; ++touch)
    viewer_.add_page_event("page x has no probe: this page has a probe already", now_ns_ + touch * kMs);
  EXPECT_LE(lines, 201);
  EXPECT_GT(lines, 50);
  EXPECT_EQ(viewer_.events().front().text, "HRTC 'desk' joined");
  EXPECT_EQ(viewer_.events().size(), 1 + ViewerCore::kMaxPageEvents);
  for (int stop = 0; stop < 1000; ++stop) viewer_.stop_forces("flood", now_ns_);
  EXPECT_EQ(viewer_.events().front().text, "HRTC 'desk' joined");
}

TEST_F(ViewerCoreTest, NoMeshFrameNamesAnObjectThatThePageDoesNotKnow) {
  PageFeed feed{viewer_};
  std::set<std::uint32_t> known;
  int frames = 0;
  after_step = [&] {
    while (const auto message = feed.next(now_ns_)) {
      if (message->is_text) {
        const nlohmann::json text = nlohmann::json::parse(message->bytes);
        if (text["type"] != "scene") continue;
        known.clear();
        for (const auto& object : text["objects"]) known.insert(object["number"].get<std::uint32_t>());
      } else if (message->bytes[0] == 1) {
        std::uint32_t number = 0;
        std::memcpy(&number, &message->bytes[4], sizeof number);
        EXPECT_EQ(known.count(number), 1u);
        ++frames;
      }
    }
    viewer_.add_event("an event delays the next scene", now_ns_);
  };
  run(500 * kMs);
  for (const bool withdrawn : {true, false})
    for (session::CatalogueEntry entry : host_.catalogue()) {
      entry.origin = {kSession, kHost, 1, now_ns_};
      entry.withdrawn = withdrawn;
      viewer_.on_catalogue(entry);
      run(500 * kMs);
    }
  EXPECT_EQ(frames, 2) << "one for each offer";
}

/// An HRTC that publishes the regions of its mesh, without a host of its own.
class ShownMeshTest : public ViewerCoreTest {
 protected:
  ShownMeshTest() {
    for (std::uint32_t i = 0; i < model_.summary.regions; ++i)
      EXPECT_EQ(hrtc_.load(spm::RegionId{i}), spm::AcceptResult::kAccepted);
    on_hrtc("desk");
  }
  void on_hrtc(const std::string& name) {
    session::RosterEntry entry;
    entry.origin = {kSession, session::id_of(name), 1, now_ns_};
    entry.role = session::Role::kHrtc;
    entry.name = name;
    entry.session = "session";
    entry.heartbeat = ++heartbeats_;
    viewer_.on_roster(entry, now_ns_);
  }
  /// `ahead_ns`: error of the sample's sending time.
  void publish(const std::string& name, const spm::Forest& forest, bool complete = true, std::int64_t ahead_ns = 0) {
    std::vector<spm::Forest::InUse> in_use(forest.copy_in_use(nullptr, 0));
    (void)forest.copy_in_use(in_use.data(), static_cast<std::uint32_t>(in_use.size()));
    session::ShownRegions shown;
    shown.origin = {kSession, session::id_of(name), 1, now_ns_ + ahead_ns};
    shown.object_id = session::id_of("sphere");
    shown.digest = model_.summary.digest;
    shown.mesh_hash = forest.mesh_hash();
    shown.complete = complete;
    for (const spm::Forest::InUse& region : in_use)
      shown.regions.push_back({spm::index(region.region), region.applied});
    viewer_.on_shown_regions(shown, now_ns_);
  }
  /// Runs while HRTCs send heartbeats and their regions.
  void run_with(const std::map<std::string, const spm::Forest*>& hrtcs, std::int64_t ns) {
    for (const std::int64_t end_ns = now_ns_ + ns; now_ns_ < end_ns;) {
      for (const auto& [name, forest] : hrtcs) {
        on_hrtc(name);
        publish(name, *forest);
      }
      run(50 * kMs);
    }
  }

  test_support::HrtcModel hrtc_{model_, spm::PoolSettings::for_slots(40000)};
  std::uint64_t heartbeats_ = 0;
};

TEST_F(ShownMeshTest, TheMeshIsThatOfTheOnlyHrtcAlsoIfItIsPartlyRefined) {
  run(500 * kMs);
  (void)hrtc_.refine({spm::RegionId{1}, spm::RegionId{2}}, 20000);
  ASSERT_NE(hrtc_.refine({spm::RegionId{3}}, 300), spm::Advance::kDone);
  run_with({{"desk", &hrtc_.forest()}}, 1000 * kMs);
  EXPECT_NE(hrtc_.forest().mesh_hash(), 0u);
  EXPECT_EQ(object().mesh.mesh_hash(), hrtc_.forest().mesh_hash());
  EXPECT_EQ(viewer_.published_hash(session::id_of("desk"), session::id_of("sphere")), hrtc_.forest().mesh_hash());

  (void)hrtc_.refine({});
  run_with({{"desk", &hrtc_.forest()}}, 500 * kMs);
  EXPECT_EQ(object().mesh.mesh_hash(), 0u) << "the HRTC shows its base mesh";
}

TEST_F(ShownMeshTest, OneTimeFarAheadDropsNoLaterRegions) {
  const auto published = [this] { return viewer_.published_hash(session::id_of("desk"), session::id_of("sphere")); };
  run(500 * kMs);
  for (const bool is_first : {true, false}) {
    SCOPED_TRACE(is_first ? "the first sample" : "a later sample");
    if (!is_first) run_with({{"desk", &hrtc_.forest()}}, 200 * kMs);
    on_hrtc("desk");
    const auto before = published();
    publish("desk", hrtc_.forest(), true, 1'000'000 * kMs);
    (void)hrtc_.refine({spm::RegionId{is_first ? 1u : 2u}});
    run(50 * kMs);
    EXPECT_NE(published(), hrtc_.forest().mesh_hash());
    publish("desk", hrtc_.forest());
    EXPECT_EQ(published(), hrtc_.forest().mesh_hash());
    EXPECT_NE(published(), before);
  }
}

TEST_F(ShownMeshTest, OvertakenRegionsAreNotShown) {
  run_with({{"desk", &hrtc_.forest()}}, 600 * kMs);
  const auto base = viewer_.published_hash(session::id_of("desk"), session::id_of("sphere"));
  (void)hrtc_.refine({spm::RegionId{1}});
  publish("desk", hrtc_.forest(), true, -200 * kMs);
  EXPECT_EQ(viewer_.published_hash(session::id_of("desk"), session::id_of("sphere")), base);
}

TEST_F(ShownMeshTest, TheMeshOfOneOfTwoHrtcsCanBeChosen) {
  test_support::HrtcModel other{model_, spm::PoolSettings::for_slots(40000)};
  for (std::uint32_t i = 0; i < model_.summary.regions; ++i) (void)other.load(spm::RegionId{i});
  (void)hrtc_.refine({spm::RegionId{1}});
  (void)other.refine({spm::RegionId{9}});
  const std::map<std::string, const spm::Forest*> both{{"desk", &hrtc_.forest()}, {"lab", &other.forest()}};
  run_with(both, 1500 * kMs);
  (void)hrtc_.refine({spm::RegionId{1}, spm::RegionId{9}});
  EXPECT_EQ(object().mesh.mesh_hash(), hrtc_.forest().mesh_hash()) << "without a choice, the union of both";

  viewer_.show_meshes_of("lab");
  run_with(both, 500 * kMs);
  EXPECT_EQ(object().mesh.mesh_hash(), other.forest().mesh_hash());
}

TEST_F(ShownMeshTest, RegionsAreMarkedAsResidentPredictedOrInContactAndPagesReceiveThem) {
  run(500 * kMs);
  const spm::RegionGrid grid{model_.summary.grid, model_.regions};
  const double scale = object().entry.scale;
  const auto distance = [&](std::uint32_t region, const Vec3d& at) {  // m
    return scale * std::sqrt(grid.squared_distance(spm::RegionId{region}, at / scale));
  };
  const Vec3d at{kRadius, 0, 0}, above{0, kRadius + 0.004, 0};
  std::uint32_t far = 0;
  while (distance(far, at) < kRadius || distance(far, above) < kRadius) ++far;
  (void)hrtc_.refine({spm::RegionId{far}});
  place_probe(at);
  state_->status = session::kInContact;
  state_->object_id = session::id_of("sphere");
  session::ProbeState hovering = *state_;  // another user, who does not touch
  hovering.user_id = session::id_of("bob");
  hovering.status = 0;
  hovering.device.position = {above[0], above[1], above[2]};
  PageFeed feed{viewer_};
  std::optional<PageMessage> frame;
  after_step = [&] {
    ++hovering.sequence;
    viewer_.on_probe_state(hovering, now_ns_);
    while (auto message = feed.next(now_ns_))
      if (!message->is_text && message->bytes[0] == 3) frame = std::move(message);
  };
  run_with({{"desk", &hrtc_.forest()}}, 1000 * kMs);

  std::size_t in_contact = 0;
  for (std::uint32_t region = 0; region < grid.size(); ++region) {
    const spm::CellBox box = grid.box(spm::RegionId{region});
    const auto marked = std::find_if(object().regions.begin(), object().regions.end(), [&](const MarkedRegion& each) {
      return Vec3d{each.low[0], each.low[1], each.low[2]}.isApprox(box.low, 1e-6);
    });
    const bool touches = distance(region, at) <= 0.003;
    in_contact += touches ? 1 : 0;
    if (touches || region == far) {
      ASSERT_NE(marked, object().regions.end()) << region;
      EXPECT_EQ(marked->mark, touches ? RegionMark::kContact : RegionMark::kResident) << region;
      EXPECT_NEAR(marked->edge, box.high[0] - box.low[0], 1e-6 * marked->edge);
    } else if (marked != object().regions.end()) {
      EXPECT_EQ(marked->mark, RegionMark::kPredicted) << region;
      EXPECT_LT(std::min(distance(region, at), distance(region, above)), 0.02) << region;
    }
  }
  EXPECT_GT(in_contact, 0u);
  EXPECT_GT(object().regions.size(), in_contact + 1) << "some are predicted";

  ASSERT_TRUE(frame.has_value());
  std::uint32_t count = 0;
  std::memcpy(&count, &frame->bytes[8], sizeof count);
  ASSERT_EQ(count, object().regions.size());
  ASSERT_EQ(frame->bytes.size(), 16 + 20 * count);
  for (std::uint32_t i = 0; i < count; ++i) {
    MarkedRegion received;
    std::memcpy(&received.mark, &frame->bytes[16 + 20 * i], 4);
    std::memcpy(received.low.data(), &frame->bytes[20 + 20 * i], 12);
    std::memcpy(&received.edge, &frame->bytes[32 + 20 * i], 4);
    EXPECT_EQ(received, object().regions[i]);
  }
}

TEST_F(ShownMeshTest, TheScreenRefinesWhatItSeesWithinTheBudgetUnlessAnHrtcIsChosen) {
  run(500 * kMs);
  (void)hrtc_.refine({spm::RegionId{1}});
  const std::map<std::string, const spm::Forest*> desk{{"desk", &hrtc_.forest()}};
  run_with(desk, 500 * kMs);
  ASSERT_EQ(object().mesh.mesh_hash(), hrtc_.forest().mesh_hash());
  const std::uint32_t without = object().mesh.faces();
  const auto faces_beyond = [&](double x) {  // m; number of faces with all corners beyond x
    return std::count_if(object().mesh.rows().begin(), object().mesh.rows().end(), [&](const ShownMesh::Face& face) {
      const auto& c = face.corners;
      return c != ShownMesh::Face{}.corners && metres(std::min({c[0], c[3], c[6]})) > x;
    });
  };
  const auto near_before = faces_beyond(0.8 * kRadius);
  viewer_.set_camera(1, {{3 * kRadius, 0, 0}, {-1, 0, 0}, 0.15, 1e-4});
  run_with(desk, 1500 * kMs);
  EXPECT_GT(object().mesh.faces(), without + 100);
  EXPECT_LE(object().mesh.faces(), without + settings().faces);
  EXPECT_GT(faces_beyond(0.8 * kRadius), 4 * near_before);

  viewer_.show_meshes_of("desk");
  run_with(desk, 500 * kMs);
  EXPECT_EQ(object().mesh.mesh_hash(), hrtc_.forest().mesh_hash());
  viewer_.show_meshes_of("");
  run_with(desk, 500 * kMs);
  EXPECT_GT(object().mesh.faces(), without + 100);
  viewer_.forget_camera(1);
  run_with(desk, 500 * kMs);
  EXPECT_EQ(object().mesh.mesh_hash(), hrtc_.forest().mesh_hash());
}

TEST_F(ShownMeshTest, FrontsAreTheSharesOfAppliedAndLoadedListEntriesByColumn) {
  run(500 * kMs);
  constexpr std::uint32_t kRegion = 1;
  (void)hrtc_.refine({spm::RegionId{kRegion}});
  run_with({{"desk", &hrtc_.forest()}}, 1000 * kMs);
  const Fronts fronts = viewer_.fronts(session::id_of("sphere"));
  const std::size_t columns = std::min<std::size_t>(Fronts::kMaxColumns, model_.summary.regions);
  ASSERT_EQ(fronts.refined.size(), columns);
  ASSERT_EQ(fronts.loaded.size(), columns);

  const auto column_of = [&](std::uint32_t region) { return region * columns / model_.summary.regions; };
  std::vector<double> entries(columns);
  for (std::uint32_t region = 0; region < model_.summary.regions; ++region)
    entries[column_of(region)] += model_.regions[region].record_count;
  for (std::size_t column = 0; column < columns; ++column) {
    const double applied = column == column_of(kRegion) ? model_.regions[kRegion].record_count : 0;
    EXPECT_NEAR(fronts.refined[column], applied / std::max(entries[column], 1.0), 1e-12) << column;
    EXPECT_GE(fronts.loaded[column], fronts.refined[column]) << column;
  }
  EXPECT_GT(fronts.refined[column_of(kRegion)], 0);
}

TEST_F(ShownMeshTest, ALossIsShownUntilTheHrtcReportsNoneForTwoSeconds) {
  const std::map<std::string, const spm::Forest*> desk{{"desk", &hrtc_.forest()}};
  run_with(desk, 100 * kMs);
  session::Metrics metrics;
  metrics.origin = {kSession, session::id_of("desk"), 1, now_ns_};
  metrics.figures = {{"lost.0000000000000011", 0.1}, {"lost.0000000000000012", 0.25}};
  viewer_.on_metrics(metrics, now_ns_);
  run_with(desk, 1500 * kMs);
  EXPECT_EQ(viewer_.lost_share(session::id_of("desk")), 0.25);
  run_with(desk, 1000 * kMs);
  EXPECT_EQ(viewer_.lost_share(session::id_of("desk")), 0);
}

TEST_F(ShownMeshTest, AnIncompleteListIsNotApplied) {
  run(500 * kMs);
  (void)hrtc_.refine({spm::RegionId{1}});
  for (int i = 0; i < 20; ++i) {
    on_hrtc("desk");
    publish("desk", hrtc_.forest(), false);
    run(50 * kMs);
  }
  EXPECT_EQ(object().mesh.mesh_hash(), 0u);
}

TEST_F(ViewerCoreTest, AViewerLeavesIfAnOlderProgramHasItsName) {
  run(300 * kMs);
  session::RosterEntry other = viewer_.roster_entry(false, now_ns_);
  other.origin.incarnation = 5;
  other.joined_ns = 0;
  other.session_time_ns = 100'000 * kMs;
  for (int beat = 0; beat < 10; ++beat) {
    other.heartbeat = 1000 + static_cast<std::uint64_t>(beat);
    viewer_.on_roster(other, now_ns_);
    run(50 * kMs);
  }
  EXPECT_TRUE(viewer_.is_name_taken());
}

}  // namespace
}  // namespace tactus::viewer
