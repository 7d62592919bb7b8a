// An HRTC loads the pages of a directory near its tip, and drops others when its memory for directories is full.
#include "spm/directory.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/local_session.hpp"

namespace tactus {
namespace {

using spm::Vec3d;
using test_support::LocalSession;

/// A sphere with a radius of 0.1 m, whose small cells are in some hundred pages.
class DirectoryTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    spm::offline::BuildOptions options;
    options.partition.cell_faces = 16;
    options.partition.max_cell_faces = 40;
    built_ = new spm::offline::BuiltModel{
        spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 60'000), options)};
  }
  static void TearDownTestSuite() { delete built_; }

  DirectoryTest() {
    scale_ = 0.2 / spm::longest_side(model_.summary);
    for (std::span<const spm::Region> left = model_.regions; !left.empty(); ++page_count_)
      left = left.subspan(spm::RegionPage::leading(left));
    pool_.compressed_blocks = model_.summary.records;
  }

  /// A position half a millimetre deep in the sphere.
  static Vec3d pressed_at(double angle) { return (0.1 + 0.003 - 0.0005) * Vec3d{std::cos(angle), std::sin(angle), 0}; }
  /// Moves the tip around the sphere at 5 cm/s. Returns the share of contact cycles that are exact.
  static double exact_share(LocalSession& session, int cycles) {
    double contact = 0, exact = 0;
    for (int cycle = 0; cycle < cycles; ++cycle) {
      constexpr double kAnglePerCycle = 0.05e-3 / 0.1;
      const Vec3d velocity = (pressed_at((cycle + 1) * kAnglePerCycle) - pressed_at(cycle * kAnglePerCycle)) * 1000;
      const std::uint32_t status = session.step(pressed_at(cycle * kAnglePerCycle), velocity).probes[0].status;
      contact += (status & session::kInContact) != 0 ? 1 : 0;
      exact += (status & session::kInContact) != 0 && (status & session::kExact) != 0 ? 1 : 0;
    }
    EXPECT_GT(contact, 0.9 * cycles);
    return exact / contact;
  }

  static spm::offline::BuiltModel* built_;
  spm::Model model_ = built_->model();
  double scale_ = 1;
  std::size_t page_count_ = 0;  // pages with regions
  spm::PoolSettings pool_ = spm::PoolSettings::for_slots(1 << 15);
};
spm::offline::BuiltModel* DirectoryTest::built_ = nullptr;

TEST_F(DirectoryTest, OnlyThePagesNearATipAreLoaded) {
  ASSERT_GT(page_count_, 60u);
  LocalSession session{{model_}, scale_, pool_};
  for (int cycle = 0; cycle < 500; ++cycle) session.step(pressed_at(0), Vec3d::Zero());
  EXPECT_NE(session.step(pressed_at(0), Vec3d::Zero()).probes[0].status & session::kExact, 0u);
  const std::size_t at_rest = session.loader().grid(0).pages();
  EXPECT_GT(at_rest, 0u);
  EXPECT_LE(at_rest, 8u);
  EXPECT_GT(exact_share(session, 4000), 0.99);
  EXPECT_GT(session.loader().grid(0).pages(), at_rest);
  EXPECT_LT(session.loader().grid(0).pages(), page_count_ / 2);
  EXPECT_EQ(session.core().intake().objects().pages(0).size(), session.loader().grid(0).pages());
}

TEST_F(DirectoryTest, UnusedPagesAreDroppedWhenTheMemoryForDirectoriesIsFull) {
  hrtc_service::LoaderSettings settings;
  const std::uint32_t max_pages = spm::RegionGrid::pages_in_bounds(model_.summary);
  const std::uint64_t page = (spm::directory_bytes(model_.summary, pool_, model_.regions) -
                              spm::directory_bytes(model_.summary, pool_, static_cast<std::uint32_t>(page_count_))) /
                             page_count_;
  settings.directory_bytes = spm::directory_bytes(model_.summary, pool_, max_pages) + 24 * page;
  LocalSession session{{model_}, scale_, pool_, 2, settings};
  for (int cycle = 0; cycle < 500; ++cycle) session.step(pressed_at(0), Vec3d::Zero());
  for (int turn = 0; turn < 3; ++turn) {
    EXPECT_GT(exact_share(session, 12'566), 0.98) << turn;
    EXPECT_LE(session.loader().directory_bytes_used(), settings.directory_bytes);
    EXPECT_LT(session.loader().grid(0).pages(), page_count_ / 2);
    EXPECT_EQ(session.core().intake().objects().pages(0).size(), session.loader().grid(0).pages());
  }
  EXPECT_EQ(session.loader().figures().refused_other, 0u);
  for (const std::string& event : session.events) EXPECT_THAT(event, testing::Not(testing::HasSubstr("coarse")));
}

TEST_F(DirectoryTest, AnotherGatewayLoadsThePagesThatTheServoHas) {
  LocalSession session{{model_}, scale_, pool_};
  EXPECT_GT(exact_share(session, 3000), 0.99);
  for (int cycle = 0; cycle < 500; ++cycle) session.step(pressed_at(0), Vec3d::Zero());
  const std::size_t pages = session.loader().grid(0).pages();
  const std::uint64_t loaded = session.loader().figures().regions_loaded;
  session.restart_gateway();
  for (int cycle = 0; cycle < 1500; ++cycle)
    ASSERT_NE(session.step(pressed_at(0), Vec3d::Zero()).probes[0].status & session::kExact, 0u) << cycle;
  EXPECT_GE(session.loader().grid(0).pages(), pages);
  EXPECT_EQ(session.core().intake().objects().pages(0).size(), session.loader().grid(0).pages());
  EXPECT_EQ(session.loader().figures().regions_loaded, loaded);
  EXPECT_EQ(session.loader().figures().refused_other, 0u);
}

}  // namespace
}  // namespace tactus
