#include "viewer/viewer_core.hpp"

#include <set>

#include "spm/model.hpp"
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
        is_near = is_near || (Vec3d{face[i][0], face[i][1], face[i][2]} * object().entry.scale - centre).norm() < distance;
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
  } each{viewer_}, last{viewer_};
  after_step = [&] { each.receive(now_ns_); };
  run(500 * kMs);
  last.receive(now_ns_);
  for (int step = 0; step < 60; ++step) {
    place_probe(kRadius * Vec3d{std::cos(0.1 * step), std::sin(0.1 * step), 0});
    run(50 * kMs);
  }
  run(200 * kMs);
  last.receive(now_ns_);

  EXPECT_EQ(each.rows, object().mesh.rows());
  EXPECT_EQ(last.rows, object().mesh.rows());
  EXPECT_EQ(last.frames, 2) << "a page that takes no messages gets all changes in one frame";
  EXPECT_GT(each.frames, 10);
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
  EXPECT_TRUE(viewer_.are_forces_stopped());
  run(2000 * kMs);

  EXPECT_GE(stops_sent_, 50);
  const int sent = stops_sent_;
  run(500 * kMs);
  EXPECT_EQ(stops_sent_, sent);
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
