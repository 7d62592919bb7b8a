// A replay of a flight recording must compute every force again, to the bit, and must report any difference.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <xmmintrin.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>

#include "hrtc_service/servo/flight_saver.hpp"
#include "hrtc_service/servo/flight_store.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/rotation.hpp"
#include "tests/hrtc_service/flight_files.hpp"
#include "tests/support/local_session.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus {
namespace {

using hrtc_service::FlightOptions;
using hrtc_service::FlightReport;
using hrtc_service::FlightStore;
using hrtc_service::flight_support::kSphereRadius;
using hrtc_service::flight_support::position_on_sphere;
using spm::Vec3d;
using test_support::LocalSession;

constexpr std::uint32_t kCyclesPerSecond = 1000;  // cycles
constexpr std::uint64_t kFlightSeed = 5;
// Slots of a pool / record parts of the model. The large pool retains many regions.
constexpr double kSmallPool = 0.17, kLargePool = 1.5;

/// Two tips on a sphere with friction. The pool holds a fifth of the model, so that regions are loaded and retired
/// during the whole run. Refinement ends early at random, poses become stale, the object moves, and emergency stops and
/// a device fault are reset.
class FlightReplayTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    built_ = new spm::offline::BuiltModel{
        spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 24000))};
    encoded_ = new spm::codec::EncodedModel{built_->model()};
  }
  static void TearDownTestSuite() {
    delete encoded_;
    delete built_;
  }

  /// `seconds`: length of the recording, which ends with the last cycle. `drains`: returns whether the store reads the
  /// recorder after this cycle. `pool_share`: slots of the pool / record parts of the model.
  void record(
      int cycles, double seconds, const std::function<bool(int)>& drains = [](int) { return true; },
      double pool_share = kSmallPool) {
    const spm::Model model = built_->model();
    const double radius = (model.summary.bounds_max[0] - model.summary.bounds_min[0]) / 2;
    const spm::PoolSettings pool =
        spm::PoolSettings::for_slots(static_cast<std::uint32_t>(pool_share * model.summary.parts) + 600);
    session::Material material;
    material.static_friction = 0.5;
    material.dynamic_friction = 0.4;
    hrtc_service::LoaderSettings loader;
    loader.tool = tool_.get();
    const std::vector<spm::Model> models(withdraws_ ? 2 : 1, model);
    const double scale = kSphereRadius / radius;
    LocalSession session{models, scale, pool, 2, loader, material, movable_ ? 0.5 : 0};
    hrtc_service::FlightRecorder recorder{kCyclesPerSecond};
    session.cycle().set_observer(&recorder);
    FlightStore store{
        recorder,
        hrtc_service::flight_start("desk", LocalSession::cycle_settings(tool_.get()), pool, LocalSession::specs()),
        seconds, FlightStore::bytes_for(seconds, 0.001, 2)};
    std::mt19937_64 random{kFlightSeed};
    const auto position = [](double cycle, double phase) { return position_on_sphere(cycle * 3e-3 + phase); };
    std::uint64_t contact_cycles = 0;
    for (int cycle = 0; cycle < cycles; ++cycle) {
      if (cycle % 700 == 650)  // the haptic thread is delayed for 200 cycles, and then receives all arrivals at once
        for (int i = 0; i < 200; ++i) session.prepare(position(cycle + 2 * i, 0), Vec3d::Zero());
      const auto velocity = [&](double phase) -> Vec3d {
        return (position(cycle + 1, phase) - position(cycle, phase)) * 1000;
      };
      session.prepare(position(cycle, 0), velocity(0));
      const auto tilted = [&](double phase) {
        return spm::rotation_between(Vec3d::UnitZ(), position(cycle, phase) + Vec3d{0.03, 0, 0});
      };
      session.inputs()[0].device.orientation = tilted(0);
      hrtc_service::ProbeInput& other = session.inputs()[1];
      other.device.orientation = tilted(2);
      other.active = cycle % 3000 > 400;
      other.device.position = position(cycle, 2) + (withdraws_ ? Vec3d::UnitX() : Vec3d{Vec3d::Zero()});
      other.device.velocity = velocity(2);
      if (withdraws_ && cycle % 1000 == 400) session.set_withdrawn(1, true);
      if (withdraws_ && cycle % 1000 == 700) session.set_withdrawn(1, false);
      other.failed = cycle == 2600;
      session.inputs()[0].pose_age = cycle % 1500 > 1300 && cycle % 1500 < 1400 ? 0.001 * (cycle % 1500 - 1300) : 0;
      if (movable_ && cycle % 700 > 300) session.inputs()[0].device.buttons = haptics::kGrabButton;
      if (cycle % 700 == 0) session.inputs()[0].device.buttons = 0;
      if (cycle % 2000 == 1800) session.cycle().stop(haptics::Fault::kEmergencyStop);
      if (cycle % 2000 == 1900 || cycle == 2700) session.cycle().reset_faults();
      if (cycle > 2000 && cycle % 1000 < 300 && !session.cycle().objects().empty()) {
        session::Pose pose;
        pose.position = {1e-5 * (cycle % 1000), 0, 0};
        session.cycle().move(*session.cycle().objects().front(), hrtc_service::Placement{pose, scale});
      }
      const std::uint32_t budget = random() % 4 == 0 ? static_cast<std::uint32_t>(random() % 500) : 1u << 20;
      const std::uint32_t status = session.run_cycle(budget).probes[0].status;
      contact_cycles += (status & session::kInContact) != 0 ? 1 : 0;
      held_cycles_ += (status & session::kHolding) != 0 ? 1 : 0;
      if (drains(cycle)) store.drain();
    }
    EXPECT_GT(contact_cycles, static_cast<std::uint64_t>(cycles) / 2);
    EXPECT_LE(store.bytes(), FlightStore::bytes_for(seconds, 0.001, 2));
    (void)store.write(file_, "a test");
  }

  [[nodiscard]] FlightReport replay(bool accepts_any_build = false) const {
    hrtc_service::FlightReplayOptions options = hrtc_service::flight_support::replay_options(*encoded_);
    options.accepts_any_build = accepts_any_build;
    return hrtc_service::replay_flight(file_, options);
  }
  /// The error message of the replay.
  [[nodiscard]] std::string refusal() const {
    try {
      (void)replay();
    } catch (const std::exception& error) {
      return error.what();
    }
    return "replayed";
  }
  /// Applies `change` to each message of the recording.
  void rewrite(const std::function<void(trace::FlightMessage&)>& change) const {
    std::vector<trace::FlightMessage> messages = hrtc_service::flight_support::read_messages(file_);
    for (trace::FlightMessage& message : messages) change(message);
    hrtc_service::flight_support::write_messages(file_, messages);
  }

  std::unique_ptr<const spm::MeshProbe> tool_;
  bool movable_ = false;    // the object is movable, and the first hand holds it at intervals
  bool withdraws_ = false;  // the second tip touches a second object, which is withdrawn at intervals
  int held_cycles_ = 0;
  test_support::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "flight.mcap";
  static spm::offline::BuiltModel* built_;
  static spm::codec::EncodedModel* encoded_;
};
spm::offline::BuiltModel* FlightReplayTest::built_ = nullptr;
spm::codec::EncodedModel* FlightReplayTest::encoded_ = nullptr;

TEST_F(FlightReplayTest, AWholeSessionIsReplayedToTheBit) {
  record(5000, 30);
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_TRUE(report.from_the_beginning);
  EXPECT_EQ(report.cycles, 5000u);
  EXPECT_GT(report.in_contact, 5000u);
  EXPECT_GT(report.stale, 50u);
  EXPECT_GT(report.faulted, 100u);
  EXPECT_EQ(report.stops, 2u);
  EXPECT_EQ(report.resets, 3u);
  EXPECT_GT(report.moves, 500u);
  EXPECT_GT(report.regions_departed, 40u);
  EXPECT_GT(report.budget_spent, 20u);
  EXPECT_EQ(report.lost, 0u);
}

TEST_F(FlightReplayTest, ARecordingOfTheLastSecondsIsReplayedToTheBit) {
  // These recordings begin while a stop is in force, while the object moves, and after refinement that ended early.
  for (const int cycles : {3850, 4250, 5999}) {
    SCOPED_TRACE(cycles);
    record(cycles, 2);
    const FlightReport report = replay();
    EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
    EXPECT_FALSE(report.from_the_beginning);
    EXPECT_GE(report.cycles, 1500u);
    EXPECT_LE(report.cycles, 3000u);
    EXPECT_GT(report.regions_departed, 20u);
  }
}

TEST_F(FlightReplayTest, AnObjectThatIsWithdrawnAndOfferedAgainIsReplayedToTheBit) {
  withdraws_ = true;
  for (const double seconds : {30., 2.}) {
    SCOPED_TRACE(seconds);
    record(
        5000, seconds, [](int) { return true; }, 2 * kSmallPool);
    const FlightReport report = replay();
    EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
    EXPECT_EQ(report.from_the_beginning, seconds > 5);
    EXPECT_EQ(report.objects_withdrawn, seconds > 5 ? 5u : 2u);
    EXPECT_GT(report.regions_departed, 20u);
  }
}

TEST_F(FlightReplayTest, AnObjectThatIsRemovedBeforeItsRecordsAreReadIsReplayedToTheBit) {
  withdraws_ = true;
  record(
      600, 30, [](int) { return false; }, 2 * kSmallPool);
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_EQ(report.objects_withdrawn, 1u);
}

TEST_F(FlightReplayTest, AnotherOrderOfTheRetainedRegionsIsReported) {
  record(
      4250, 2, [](int) { return true; }, kLargePool);
  EXPECT_EQ(replay().different_cycles, 0u);
  std::uint32_t retained = 0;
  rewrite([&](trace::FlightMessage& message) {
    auto* const state = std::get_if<trace::FlightState>(&message);
    if (state == nullptr) return;
    for (trace::FlightObjectState& object : state->objects) {
      const auto first = std::find_if(object.in_use.begin(), object.in_use.end(),
                                      [](const trace::FlightRegion& region) { return region.retained; });
      retained += static_cast<std::uint32_t>(object.in_use.end() - first);
      std::reverse(first, object.in_use.end());
    }
  });
  EXPECT_GT(retained, 3u);
  const FlightReport report = replay();
  EXPECT_GT(report.different_cycles, 0u);
  EXPECT_THAT(report.first_difference, testing::HasSubstr(", the mesh differs"));
}

TEST_F(FlightReplayTest, ToolsAreReplayedToTheBitFromTheBeginningAndFromTheMiddle) {
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  tool_ = std::make_unique<const spm::MeshProbe>(stylus.positions, stylus.faces);
  for (const double seconds : {30.0, 2.0}) {
    SCOPED_TRACE(seconds);
    record(3800, seconds);
    const FlightReport report = replay();
    EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
    EXPECT_EQ(report.from_the_beginning, seconds > 3);
    EXPECT_EQ(report.start.tool_triangles.size(), 3 * 720u);
    EXPECT_GT(report.in_contact, 900u);
  }
}

TEST_F(FlightReplayTest, HoldsAreReplayedToTheBitFromTheMiddle) {
  movable_ = true;
  record(5300, 2);
  EXPECT_GT(held_cycles_, 1000);
  const FlightReport report = replay();
  EXPECT_FALSE(report.from_the_beginning);
  EXPECT_GT(report.cycles, 1000u);
  EXPECT_EQ(report.different_cycles, 0u);
}

TEST_F(FlightReplayTest, AReplayUsesTheDenormalModeOfTheRecordingAndRestoresItsOwn) {
  constexpr unsigned kDenormalsAreZero = 0x8040;  // DAZ and FTZ
  const unsigned before = _mm_getcsr();
  _mm_setcsr(before | kDenormalsAreZero);
  record(1500, 30);
  _mm_setcsr(before);
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_EQ(_mm_getcsr(), before);
}

TEST_F(FlightReplayTest, AReplayContinuesAfterLostCycles) {
  record(11000, 30, [](int cycle) { return cycle < 2000 || cycle > 8000; });
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_EQ(report.gaps, 1u);
  EXPECT_GT(report.lost, 500u);
  EXPECT_EQ(report.cycles + report.lost, 11000u);
}

TEST_F(FlightReplayTest, AChangeOfOneBitOfOneInputIsReported) {
  record(2500, 30);
  rewrite([](trace::FlightMessage& message) {
    auto* const probe = std::get_if<trace::FlightProbe>(&message);
    if (probe != nullptr && probe->cycle == 1234 && probe->probe == 0)
      probe->position[1] = std::nextafter(probe->position[1], 1.0);
  });
  const FlightReport report = replay();
  EXPECT_GT(report.different_cycles, 0u);
  EXPECT_THAT(report.first_difference, testing::StartsWith("cycle 1234, probe 0: recorded force ("));
}

TEST_F(FlightReplayTest, ADifferenceOfTheRefinementIsReportedWithBothValues) {
  record(2500, 30);
  rewrite([](trace::FlightMessage& message) {
    auto* const refine = std::get_if<trace::FlightRefine>(&message);
    if (refine != nullptr && refine->cycle == 1234) refine->nodes_full = refine->budget_spent = 1;
  });
  EXPECT_EQ(replay().first_difference,
            "cycle 1234, refinement differs; recorded budget_spent 1, replayed 0; recorded nodes_full 1, replayed 0");
}

TEST_F(FlightReplayTest, ASmallerBudgetOfOneCycleIsReported) {
  record(2500, 30);
  bool changed = false;
  rewrite([&](trace::FlightMessage& message) {
    auto* const refine = std::get_if<trace::FlightRefine>(&message);
    if (refine == nullptr || changed || refine->cycle < 1000 || refine->granted < 2000) return;
    refine->granted /= 2;
    changed = true;
  });
  ASSERT_TRUE(changed);
  const FlightReport report = replay();
  EXPECT_GT(report.different_cycles, 0u);
  EXPECT_THAT(report.first_difference, testing::HasSubstr(", the mesh differs"));
}

TEST_F(FlightReplayTest, ATruncatedFileIsReplayedToItsEnd) {
  record(2500, 30);
  std::filesystem::resize_file(file_, std::filesystem::file_size(file_) * 2 / 3);
  const FlightReport report = replay();
  EXPECT_TRUE(report.is_truncated);
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_GT(report.cycles, 500u);
}

TEST_F(FlightReplayTest, ADifferenceInACycleWithoutRefinementIsReported) {
  record(1200, 30);
  std::vector<trace::FlightMessage> messages = hrtc_service::flight_support::read_messages(file_);
  const auto touch = std::find_if(messages.begin(), messages.end(), [](const trace::FlightMessage& message) {
    const auto* const found = std::get_if<trace::FlightTouch>(&message);
    return found != nullptr && found->cycle == 1100;
  });
  ASSERT_NE(touch, messages.end());
  messages.erase(touch + 1, messages.end());
  hrtc_service::flight_support::write_messages(file_, messages);
  EXPECT_EQ(replay().different_cycles, 0u);
  rewrite([](trace::FlightMessage& message) {
    auto* const probe = std::get_if<trace::FlightProbe>(&message);
    if (probe != nullptr && probe->cycle == 1100) probe->force[0] += 1;
  });
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 1u);
  EXPECT_THAT(report.first_difference, testing::StartsWith("cycle 1100, probe 0: recorded force ("));
}

TEST_F(FlightReplayTest, ARecordingWithoutACycleIsRefused) {
  record(1200, 30);
  std::vector<trace::FlightMessage> messages = hrtc_service::flight_support::read_messages(file_);
  ASSERT_TRUE(std::holds_alternative<trace::FlightStart>(messages.front()));
  messages.erase(messages.begin() + 1, messages.end());
  hrtc_service::flight_support::write_messages(file_, messages);
  EXPECT_THAT(refusal(), testing::HasSubstr("found no complete cycle in it"));
}

TEST_F(FlightReplayTest, AnInvalidRecordingIsRefusedWithTheReason) {
  record(1200, 30);
  const auto refusal_after = [&](const std::function<void(trace::FlightMessage&)>& change) {
    rewrite(change);
    return refusal();
  };
  EXPECT_THAT(refusal_after([](trace::FlightMessage& message) {
                if (auto* object = std::get_if<trace::FlightObject>(&message)) object->digest ^= 1;
              }),
              testing::HasSubstr("object 'object0' is of the model with digest "));
  EXPECT_THAT(refusal_after([](trace::FlightMessage& message) {
                if (auto* start = std::get_if<trace::FlightStart>(&message)) start->build = "another";
              }),
              testing::HasSubstr("recorded by build another, this is build "));
  { trace::McapWriter empty{file_, "test"}; }
  EXPECT_THAT(refusal(), testing::HasSubstr("found no flight recording in it"));
  {
    trace::McapWriter other{file_, "test"};
    other.write(other.add_channel(other.add_schema("x::Y", "omgidl", ""), "probes", "cdr"), 1, 1, 1, {});
  }
  EXPECT_THAT(refusal(), testing::HasSubstr("topic probes, message 1: not a topic of a flight recording"));
  std::filesystem::remove(file_);
  EXPECT_THAT(refusal(), testing::HasSubstr(file_.string()));
}

TEST_F(FlightReplayTest, ARecordingOfAnotherBuildIsReplayedOnRequest) {
  record(1200, 30);
  rewrite([](trace::FlightMessage& message) {
    if (auto* start = std::get_if<trace::FlightStart>(&message)) start->build = "another";
  });
  EXPECT_EQ(replay(true).different_cycles, 0u);
}

TEST(FlightSaverTest, ChangesNoFileBeforeTheEnd) {
  const test_support::TemporaryFolder folder;
  FlightOptions options;
  options.seconds = 0.1;
  options.folder = folder.path();
  options.file = folder.path() / "end.mcap";
  const trace::FlightStart start =
      hrtc_service::flight_start("desk", hrtc_service::CycleSettings{}, spm::PoolSettings::for_slots(1000), {});
  { const hrtc_service::FlightSaver abandoned{options, start, 1}; }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));

  test_support::write_bytes(options.file, "an earlier recording");
  { const hrtc_service::FlightSaver abandoned{options, start, 1}; }
  EXPECT_EQ(test_support::read_bytes(options.file), "an earlier recording");

  const std::filesystem::path earlier = options.file;
  options.file = folder.path() / "link.mcap";
  std::filesystem::create_symlink("end.mcap", options.file);
  { const hrtc_service::FlightSaver abandoned{options, start, 1}; }
  EXPECT_EQ(test_support::read_bytes(earlier), "an earlier recording");
  std::filesystem::remove(earlier);
  { const hrtc_service::FlightSaver abandoned{options, start, 1}; }
  EXPECT_FALSE(std::filesystem::exists(earlier));

  options.file = folder.path() / "none" / "end.mcap";
  EXPECT_THAT([&] { const hrtc_service::FlightSaver refused(options, start, 1); },
              testing::ThrowsMessage<std::runtime_error>(testing::HasSubstr("end.mcap: No such file or directory")));
}

TEST(FlightLimit, StaysWithinAnEighthOfTheMemoryOrRecordsNothing) {
  constexpr double kPeriod = 1e-3;
  constexpr std::uint32_t kProbes = 8;
  FlightOptions ample;
  EXPECT_EQ(limit_flight(ample, std::uint64_t{1} << 32, kPeriod, kProbes),
            FlightStore::bytes_for(30, kPeriod, kProbes));
  FlightOptions scarce;
  EXPECT_EQ(limit_flight(scarce, 64u << 20, kPeriod, kProbes), 8u << 20);
  EXPECT_EQ(scarce.max_bytes, 8u << 20);
  EXPECT_EQ(scarce.seconds, 30);
  FlightOptions tiny;
  EXPECT_EQ(limit_flight(tiny, 8u << 20, kPeriod, kProbes), 0u);
  EXPECT_EQ(tiny.seconds, 0);
  FlightOptions off;
  off.seconds = 0;
  EXPECT_EQ(limit_flight(off, 64u << 20, kPeriod, kProbes), 0u);
}

}  // namespace
}  // namespace tactus
