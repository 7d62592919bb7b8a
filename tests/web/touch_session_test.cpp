#include "web/touch_session.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "netem/profile.hpp"
#include "spm/offline/generate.hpp"

namespace tactus::web {
namespace {

using spm::offline::generate;
using spm::offline::Shape;

constexpr double kSize = 0.1;

TouchSession organ() { return {"organ", generate(Shape::kOrgan, 20'000), kSize, 1}; }

double norm(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }

void run(TouchSession& session, int ms) {
  for (int i = 0; i < ms; ++i) session.step();
}

TEST(TouchSession, APressedHandFeelsAnExactContactAndAReleasedOneNone) {
  TouchSession session = organ();
  const double top = session.bounds()[5];
  session.move_hand({0, 0, top + 0.02});
  run(session, 1500);
  EXPECT_EQ(norm(session.users()[0].force), 0);
  session.move_hand({0, 0, 0});
  run(session, 1500);
  const UserView& you = session.users()[0];
  EXPECT_EQ(you.in_contact, 1);
  EXPECT_EQ(you.exact, 1);
  EXPECT_GT(you.force[2], 0.5) << "the surface pushes the hand up";
  EXPECT_GT(you.proxy[2], you.device[2]);
  session.move_hand({0, 0, top + 0.02});
  run(session, 800);
  EXPECT_EQ(norm(session.users()[0].force), 0);
}

TEST(TouchSession, TheSecondUserFollowsItsScript) {
  TouchSession session = organ();
  int in_contact = 0;
  for (int i = 0; i < 6000; ++i) {
    session.step();
    in_contact += session.users()[1].in_contact != 0 ? 1 : 0;
  }
  EXPECT_GT(in_contact, 2000);
}

TEST(TouchSession, TheHandMovesAtLimitedSpeed) {
  TouchSession session = organ();
  session.move_hand({0, 0, 0.2});
  run(session, 1000);
  session.move_hand({0, 0, 0.6});
  run(session, 100);
  const double after = session.users()[0].device[2];
  EXPECT_LT(after, 0.26);
  EXPECT_GT(after, 0.21);
}

TEST(TouchSession, ALongerDelayGivesALongerRoundTrip) {
  TouchSession session = organ();
  run(session, 2000);
  const double before = session.figures().round_trip_ms;
  session.set_link({150, 0, 0, 20});
  run(session, 6000);
  EXPECT_GT(before, 15);
  EXPECT_LT(before, 60);
  EXPECT_GT(session.figures().round_trip_ms, 200);
}

TEST(TouchSession, RefusesAnImpossibleLink) {
  TouchSession session = organ();
  EXPECT_THROW(session.set_link({10, 0, 101, 20}), netem::LinkError);
}

TEST(TouchSession, TheMeshViewHasTheShownFaces) {
  TouchSession session = organ();
  session.move_hand({0, 0, session.bounds()[5] + 0.02});
  run(session, 1500);
  session.move_hand({0, 0, 0});
  run(session, 1500);
  ASSERT_TRUE(session.update_mesh());
  EXPECT_FALSE(session.update_mesh()) << "nothing has changed";
  const MeshView& mesh = session.mesh();
  ASSERT_EQ(mesh.fine.size(), static_cast<std::size_t>(session.figures().faces));
  ASSERT_EQ(mesh.corners.size(), 9 * mesh.fine.size());
  EXPECT_GT(session.figures().fine_faces, 100);
  EXPECT_LT(session.figures().faces, session.figures().all_faces);
  for (std::size_t i = 0; i < mesh.corners.size(); ++i) {
    const double world = session.metres_per_unit() * mesh.corners[i];
    ASSERT_GE(world, session.bounds()[i % 3] - 1e-6);
    ASSERT_LE(world, session.bounds()[3 + i % 3] + 1e-6);
  }
}

}  // namespace
}  // namespace tactus::web
