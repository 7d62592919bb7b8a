// Objects that a host offers while the regions of other objects fill the pool.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/local_session.hpp"

namespace tactus::hrtc_service {
namespace {

using test_support::LocalSession;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;
using testing::SizeIs;

constexpr double kTip = 0.003, kRadius = 0.05;  // m

const spm::offline::BuiltModel& large_sphere() {
  static const spm::offline::BuiltModel kBuilt =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 12'000));
  return kBuilt;
}

/// A sphere with a base mesh of 2,000 faces, which takes some 1,000 slots.
const spm::offline::BuiltModel& late_sphere() {
  static const spm::offline::BuiltModel kBuilt = [] {
    spm::offline::BuildOptions options;
    options.simplify.base_faces = 2000;
    return spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 6'000), options);
  }();
  return kBuilt;
}

double scale_of(const spm::Model& model) {
  return 2 * kRadius / static_cast<double>(model.summary.bounds_max[0] - model.summary.bounds_min[0]);
}

std::uint32_t base_slots(const spm::offline::BuiltModel& built) {
  return spm::Cache::slots_for_base(built.model().summary);
}

/// A tip circles on a large sphere, whose regions fill the pool. A host offers a second sphere only later.
class LateObjectTest : public testing::Test {
 protected:
  /// `spare_slots`: slots of the pool in addition to those of both base meshes; -1: the pool has one too few for them.
  /// `store_blocks`: blocks of the store; 0: in proportion to the pool.
  void start(int spare_slots, std::uint32_t store_blocks = 0) {
    const spm::Model large = large_sphere().model();
    const auto pool_slots =
        static_cast<std::uint32_t>(static_cast<int>(base_slots(large_sphere()) + late_base_slots_) + spare_slots);
    spm::PoolSettings pool = spm::PoolSettings::for_slots(pool_slots);
    if (store_blocks > 0) pool.compressed_blocks = store_blocks;
    session_.emplace(std::vector<spm::Model>{large, late_sphere().model()}, scale_of(large), pool);
    session_->set_withdrawn(1, true);
  }
  void run(int cycles) {
    for (int i = 0; i < cycles; ++i, ++cycle_) {
      constexpr double kStep = 0.004;  // radians per cycle; 0.2 m/s
      const auto at = [](double angle) {
        return spm::Vec3d{(kRadius + kTip - 0.0005) * std::cos(angle), (kRadius + kTip - 0.0005) * std::sin(angle), 0};
      };
      session_->step(at(cycle_ * kStep), 1000 * (at((cycle_ + 1) * kStep) - at(cycle_ * kStep)));
    }
  }
  [[nodiscard]] std::uint32_t slots_free() const {
    const LoaderFigures figures = session_->loader().figures();
    return figures.slots_limit - figures.slots_used;
  }

  const std::uint32_t late_base_slots_ = base_slots(late_sphere());
  std::optional<LocalSession> session_;
  int cycle_ = 0;
};

TEST_F(LateObjectTest, RetainedRegionsAreCoarsenedForTheBaseMeshOfANewObject) {
  start(1500);
  run(3000);
  ASSERT_THAT(session_->loader().objects(), SizeIs(1));
  ASSERT_LT(slots_free(), late_base_slots_) << "the pool is not full";
  session_->set_withdrawn(1, false);
  run(500);
  EXPECT_THAT(session_->loader().objects(), SizeIs(2));
  EXPECT_EQ(session_->loader().figures().objects_refused, 0u);
  EXPECT_THAT(session_->events, Not(Contains(HasSubstr("refused"))));
}

TEST_F(LateObjectTest, ABaseMeshArrivesAlthoughTheStoreIsFull) {
  for (const std::uint32_t store_blocks : {200, 300, 400, 600, 800, 1200}) {
    start(6000, store_blocks);
    run(1000);
    session_->set_withdrawn(1, false);
    run(1000);
    EXPECT_THAT(session_->loader().objects(), SizeIs(2)) << store_blocks << " blocks";
  }
}

TEST_F(LateObjectTest, ABaseMeshThatWouldNotFitEvenWithoutRegionsIsRefusedAtOnce) {
  start(-1);
  run(1000);
  session_->set_withdrawn(1, false);
  run(500);
  EXPECT_THAT(session_->loader().objects(), SizeIs(1));
  EXPECT_THAT(session_->events, Contains(HasSubstr("object1: refused, its base mesh takes")));
}

TEST_F(LateObjectTest, WithdrawingAnObjectWhoseBaseMeshWaitsForSlotsFreesItsReservedMemory) {
  start(1500);
  run(3000);
  const std::uint64_t directory_bytes = session_->loader().directory_bytes_used();
  for (int round = 0; round < 20; ++round) {
    session_->set_withdrawn(1, false);
    run(10);  // long enough for the base mesh to arrive, too short to coarsen the regions that fill the pool
    ASSERT_THAT(session_->loader().objects(), SizeIs(1)) << round;
    session_->set_withdrawn(1, true);
    run(1500);
    ASSERT_EQ(session_->loader().directory_bytes_used(), directory_bytes) << round;
  }
  session_->set_withdrawn(1, false);
  run(500);
  EXPECT_THAT(session_->loader().objects(), SizeIs(2));
}

}  // namespace
}  // namespace tactus::hrtc_service
