// Flight recordings: what a cycle did is done again, to the bit, from its beginning and from the midst, and what is not
// the same is found.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <xmmintrin.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "hrtc_service/flight_replay.hpp"
#include "hrtc_service/flight_saver.hpp"
#include "hrtc_service/flight_store.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/rotation.hpp"
#include "tests/support/local_session.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus {
namespace {

using hrtc_service::FlightOptions;
using hrtc_service::FlightReport;
using hrtc_service::FlightStore;
using spm::Vec3d;
using test_support::LocalSession;

constexpr std::uint32_t kSecond = 1000;  // cycles
constexpr std::uint64_t kSeed = 5;
constexpr double kScarce = 0.17, kRestful = 1.5;  // of the model's records in slots: half of what these show may rest

/// Two tips on a sphere with friction, in a pool of a fifth: regions come and go all the while, refinement is cut short
/// by chance, poses grow old, an emergency stop and a device that fails end in resets, the object moves.
class Flight : public ::testing::Test {
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

  /// `drains`: whether the store looks for records after this cycle.
  void record(
      int cycles, double seconds, const std::function<bool(int)>& drains = [](int) { return true; },
      double share = kScarce) {
    const spm::Model model = built_->model();
    const double radius = (model.summary.bounds_max[0] - model.summary.bounds_min[0]) / 2;
    const spm::PoolSettings pool =
        spm::PoolSettings::for_slots(static_cast<std::uint32_t>(share * model.summary.parts) + 600);
    session::Material material;
    material.static_friction = 0.5;
    material.dynamic_friction = 0.4;
    hrtc_service::LoaderSettings loader;
    loader.tool = tool_;
    const std::vector<spm::Model> models(withdraws_ ? 2 : 1, model);
    LocalSession session{models, 0.05 / radius, pool, 2, loader, material, movable_ ? 0.5 : 0};
    hrtc_service::FlightRecorder recorder{kSecond};
    session.cycle().set_observer(&recorder);
    hrtc_service::FlightStore store{
        recorder, hrtc_service::flight_start("desk", LocalSession::cycle_settings(tool_), pool, LocalSession::specs()),
        seconds, hrtc_service::FlightStore::bytes_for(seconds, 0.001, 2)};
    std::mt19937_64 random{kSeed};
    const auto at = [](double cycle, double turn) -> Vec3d {
      const double angle = cycle * 3e-3 + turn;
      return 0.0525 *
             Vec3d{std::cos(angle), std::sin(angle) * std::cos(angle / 7), std::sin(angle) * std::sin(angle / 7)};
    };
    std::uint64_t contact = 0;
    for (int cycle = 0; cycle < cycles; ++cycle) {
      if (cycle % 700 == 650)  // the haptic thread does not come to run: what comes and goes meanwhile arrives at once
        for (int i = 0; i < 200; ++i) session.prepare(at(cycle + 2 * i, 0), Vec3d::Zero());
      const auto velocity = [&](double turn) -> Vec3d { return (at(cycle + 1, turn) - at(cycle, turn)) * 1000; };
      session.prepare(at(cycle, 0), velocity(0));
      const auto leaning = [&](double turn) {
        return spm::rotation_between(Vec3d::UnitZ(), at(cycle, turn) + Vec3d{0.03, 0, 0});
      };
      session.inputs()[0].device.orientation = leaning(0);
      hrtc_service::ProbeInput& other = session.inputs()[1];
      other.device.orientation = leaning(2);
      other.active = cycle % 3000 > 400;
      other.device.position = at(cycle, 2) + (withdraws_ ? Vec3d::UnitX() : Vec3d{Vec3d::Zero()});
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
        session.cycle().move(*session.cycle().objects().front(), hrtc_service::Placement{pose, 0.05 / radius});
      }
      const std::uint32_t budget = random() % 4 == 0 ? static_cast<std::uint32_t>(random() % 500) : 1u << 20;
      const std::uint32_t status = session.run_cycle(budget).probes[0].status;
      contact += (status & session::kInContact) != 0 ? 1 : 0;
      held_ += (status & session::kHolding) != 0 ? 1 : 0;
      if (drains(cycle)) store.drain();
    }
    EXPECT_GT(contact, static_cast<std::uint64_t>(cycles) / 2);
    EXPECT_LE(store.bytes(), hrtc_service::FlightStore::bytes_for(seconds, 0.001, 2));
    (void)store.write(file_, "a test");
  }

  [[nodiscard]] static hrtc_service::FlightReplayOptions options() {
    hrtc_service::FlightReplayOptions options;
    options.model = [](std::uint64_t digest) {
      return digest == encoded_->compressed().summary().digest ? &encoded_->compressed() : nullptr;
    };
    return options;
  }
  [[nodiscard]] FlightReport replay() const { return hrtc_service::replay_flight(file_, options()); }
  [[nodiscard]] std::string refusal() const {
    try {
      (void)replay();
    } catch (const std::exception& error) {
      return error.what();
    }
    return "replayed";
  }
  /// Writes the recording once more, with each message as `change` leaves it.
  void rewrite(const std::function<void(trace::FlightMessage&)>& change) const {
    std::vector<trace::FlightMessage> all;
    {
      trace::FlightFileReader reader{file_};
      for (trace::FlightMessage message; reader.next(message);) all.push_back(message);
    }
    trace::FlightFileWriter writer{file_};
    for (trace::FlightMessage& message : all) {
      change(message);
      writer.write(message);
    }
    writer.close();
  }

  const spm::MeshProbe* tool_ = nullptr;
  bool movable_ = false;    // and held now and then
  bool withdraws_ = false;  // a second object, which the other tip touches, again and again
  int held_ = 0;            // cycles
  test_support::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "flight.mcap";
  static spm::offline::BuiltModel* built_;
  static spm::codec::EncodedModel* encoded_;
};
spm::offline::BuiltModel* Flight::built_ = nullptr;
spm::codec::EncodedModel* Flight::encoded_ = nullptr;

TEST_F(Flight, AWholeSessionIsReplayedToTheBit) {
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

TEST_F(Flight, TheLastSecondsAreReplayedToTheBitFromTheMiddle) {
  // Begins where a stop is in force, where the object is on its way, where refinement was cut short.
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

TEST_F(Flight, AnObjectThatIsWithdrawnAndComesAgainIsReplayedToTheBit) {
  withdraws_ = true;
  for (const double seconds : {30., 2.}) {
    SCOPED_TRACE(seconds);
    record(
        5000, seconds, [](int) { return true; }, 2 * kScarce);
    const FlightReport report = replay();
    EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
    EXPECT_EQ(report.from_the_beginning, seconds > 5);
    EXPECT_EQ(report.objects_withdrawn, seconds > 5 ? 5u : 2u);
    EXPECT_GT(report.regions_departed, 20u);
  }
}

TEST_F(Flight, AnObjectThatIsGoneByTheTimeThatTheRecordingIsReadIsReplayedToTheBit) {
  withdraws_ = true;
  record(
      600, 30, [](int) { return false; }, 2 * kScarce);
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_EQ(report.objects_withdrawn, 1u);
}

TEST_F(Flight, AnotherOrderOfWhatRestsIsFound) {
  record(
      4250, 2, [](int) { return true; }, kRestful);
  EXPECT_EQ(replay().different_cycles, 0u);
  std::uint32_t resting = 0;
  rewrite([&](trace::FlightMessage& message) {
    auto* const state = std::get_if<trace::FlightState>(&message);
    if (state == nullptr) return;
    for (trace::FlightObjectState& object : state->objects) {
      const auto first = std::find_if(object.in_use.begin(), object.in_use.end(),
                                      [](const trace::FlightRegion& region) { return region.resting; });
      resting += static_cast<std::uint32_t>(object.in_use.end() - first);
      std::reverse(first, object.in_use.end());
    }
  });
  EXPECT_GT(resting, 3u);
  const FlightReport report = replay();
  EXPECT_GT(report.different_cycles, 0u);
  EXPECT_THAT(report.first_difference, testing::HasSubstr(", the mesh differs"));
}

TEST_F(Flight, ToolsAreReplayedToTheBitFromTheBeginningAndFromTheMiddle) {
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  tool_ = &probe;
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

TEST_F(Flight, HoldsAreReplayedToTheBitFromTheMiddle) {
  movable_ = true;
  record(5300, 2);
  EXPECT_GT(held_, 1000);
  const FlightReport report = replay();
  EXPECT_FALSE(report.from_the_beginning);
  EXPECT_GT(report.cycles, 1000u);
  EXPECT_EQ(report.different_cycles, 0u);
}

TEST_F(Flight, WhatTheProcessorDoesWithDenormalsIsDoneAgain) {
  const unsigned before = _mm_getcsr();
  _mm_setcsr(before | 0x8040);
  record(1500, 30);
  _mm_setcsr(before);
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_EQ(_mm_getcsr(), before) << "and left as it was";
}

TEST_F(Flight, ItGoesOnAfterCyclesThatWereLost) {
  record(11000, 30, [](int cycle) { return cycle < 2000 || cycle > 8000; });
  const FlightReport report = replay();
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_EQ(report.gaps, 1u);
  EXPECT_GT(report.lost, 500u);
  EXPECT_EQ(report.cycles + report.lost, 11000u);
}

TEST_F(Flight, OneBitOfOneInputIsFound) {
  record(2500, 30);
  rewrite([](trace::FlightMessage& message) {
    auto* const probe = std::get_if<trace::FlightProbe>(&message);
    if (probe != nullptr && probe->cycle == 1234 && probe->probe == 0)
      probe->position[1] = std::nextafter(probe->position[1], 1.0);
  });
  const FlightReport report = replay();
  EXPECT_GT(report.different_cycles, 0u);
  EXPECT_THAT(report.first_difference, testing::StartsWith("cycle 1234, probe 0: force was ("));
}

TEST_F(Flight, OnePortionOfWorkLessIsFound) {
  record(2500, 30);
  bool less = false;
  rewrite([&](trace::FlightMessage& message) {
    auto* const refine = std::get_if<trace::FlightRefine>(&message);
    if (refine == nullptr || less || refine->cycle < 1000 || refine->granted < 2000) return;
    refine->granted /= 2;
    less = true;
  });
  ASSERT_TRUE(less);
  const FlightReport report = replay();
  EXPECT_GT(report.different_cycles, 0u);
  EXPECT_THAT(report.first_difference, testing::HasSubstr(", the mesh differs"));
}

TEST_F(Flight, ACutFileIsReplayedToWhereItIsCut) {
  record(2500, 30);
  std::filesystem::resize_file(file_, std::filesystem::file_size(file_) * 2 / 3);
  const FlightReport report = replay();
  EXPECT_TRUE(report.is_truncated);
  EXPECT_EQ(report.different_cycles, 0u) << report.first_difference;
  EXPECT_GT(report.cycles, 500u);
}

TEST_F(Flight, WhatCannotBeReplayedIsRefusedWithTheReason) {
  record(1200, 30);
  const auto changed = [&](const std::function<void(trace::FlightMessage&)>& change) {
    rewrite(change);
    return refusal();
  };
  EXPECT_THAT(changed([](trace::FlightMessage& message) {
                if (auto* object = std::get_if<trace::FlightObject>(&message)) object->digest ^= 1;
              }),
              testing::HasSubstr("object 'object0' is of the model with digest "));
  EXPECT_THAT(changed([](trace::FlightMessage& message) {
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

TEST_F(Flight, AnotherBuildsRecordingIsReplayedFromItsBeginningWhenThatIsRequested) {
  record(1200, 30);
  rewrite([](trace::FlightMessage& message) {
    if (auto* start = std::get_if<trace::FlightStart>(&message)) start->build = "another";
  });
  hrtc_service::FlightReplayOptions any = options();
  any.accepts_any_build = true;
  EXPECT_EQ(hrtc_service::replay_flight(file_, any).different_cycles, 0u);
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
