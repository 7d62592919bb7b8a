/// A HostCore in virtual time: alone, and with an HrtcCore that joins it.
#include "host_service/host_core.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hrtc_service/hrtc_core.hpp"
#include "session/figures.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "study/membership_exchange.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/damaged_model.hpp"

namespace tactus::host_service {
namespace {

using spm::Vec3d;

constexpr session::Origin kSelf{kSession, kHost, 1, 0};

class HostCoreTest : public testing::Test {
 protected:
  [[nodiscard]] HostCoreSettings settings_with_body() const {
    HostCoreSettings settings = host_of("sphere", encoded_.compressed());
    settings.objects.front().config.body.emplace();
    return settings;
  }
  /// Returns a roster entry of an HRTC with the next heartbeat.
  session::RosterEntry hrtc_entry(std::uint64_t reference = 0, std::int64_t session_time_ns = 0) {
    session::RosterEntry entry;
    entry.origin = {kSession, kHrtc, 1, 0};
    entry.role = session::Role::kHrtc;
    entry.name = "hrtc";
    entry.heartbeat = ++beats_;
    entry.reference = reference;
    entry.session_time_ns = session_time_ns;
    return entry;
  }
  [[nodiscard]] static session::ClockSample clock_request(std::int64_t now_ns) {
    session::ClockSample sample;
    sample.origin = {kSession, kHrtc, 1, 0};
    sample.peer = kHost;
    sample.sequence = 1;
    sample.t0_ns = now_ns;
    return sample;
  }

  const spm::offline::BuiltModel built_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 8000));
  const spm::Model model_ = built_.model();
  const spm::codec::EncodedModel encoded_{model_};
  std::int64_t now_ = 1000 * kMs;
  std::uint64_t beats_ = 0;
};

TEST_F(HostCoreTest, AnHrtcThatJoinsLoadsTheObjectAndReachesExactContact) {
  HostCore host{kSelf, host_of("sphere", encoded_.compressed()), now_};
  std::string served_hrtc;
  host.on_receiver = [&](std::uint64_t, const std::string& name) { served_hrtc = name; };
  hrtc_service::HrtcCoreSettings settings;
  settings.pool = spm::PoolSettings::for_slots(model_.summary.parts / 2);
  hrtc_service::HrtcCore core{session::Origin{kSession, kHrtc, 1, 0}, settings};
  hrtc_service::Membership membership{
      session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session"}, core.gateway(), now_};
  const double radius = model_.summary.bounds_max[0];
  hrtc_service::Servo::Inputs inputs;
  inputs[0].active = true;
  int exact_cycles = 0;

  for (int cycle = 0; cycle < 3000; ++cycle, now_ += kMs) {
    if (cycle % 2 == 0) {
      core.gateway().tick(now_, membership.clock());
      membership.tick(now_);
    }
    study::exchange_membership(host, membership, now_);
    while (const auto demand = core.gateway().demand(now_)) host.on_demand(*demand, now_);
    while (const auto outgoing = host.next_chunk(now_)) core.gateway().on_chunk(outgoing->chunk, now_);
    core.tick_intake();
    const double progress = std::min(1.0, cycle / 2000.0);  // from 20 mm outside to 2 mm inside
    inputs[0].device.position = {radius + 0.02 - 0.022 * progress, 0, 0};
    const hrtc_service::ProbeOutput& probe = core.servo().touch(inputs, now_)[0];
    core.servo().publish(now_, now_ + kMs);
    (void)core.servo().refine(spm::Budget{1u << 16});
    constexpr std::uint32_t kExactContact = session::kInContact | session::kExact;
    if (probe.force[0] > 0.1 && (probe.status & kExactContact) == kExactContact) ++exact_cycles;
  }

  EXPECT_EQ(served_hrtc, "hrtc");
  ASSERT_EQ(core.servo().cycle().objects().size(), 1u);
  EXPECT_GT(exact_cycles, 900) << "of the last 1000 cycles";
  const session::DeliveryCounters& sent = host.delivery().counters();
  EXPECT_EQ(sent.bases, 1u);
  EXPECT_GT(sent.records, 0u);
  EXPECT_LT(sent.records, model_.summary.records / 2) << "only records near the tip are sent";
}

TEST_F(HostCoreTest, ObjectsWithoutAPoseStandSideBySideAlongX) {
  HostCoreSettings settings = host_of("a", encoded_.compressed());
  for (const char* name : {"b", "c"}) {
    settings.objects.push_back(settings.objects.front());
    settings.objects.back().config.name = name;
  }
  for (HostedObject& object : settings.objects) object.config.pose.reset();
  settings.at = {1, 2, 3};

  const HostCore host{kSelf, settings, now_};

  const std::vector<session::CatalogueEntry>& entries = host.catalogue();
  ASSERT_EQ(entries.size(), 3u);
  EXPECT_EQ(entries[0].pose.position, (std::array<double, 3>{1, 2, 3}));
  for (std::size_t i = 1; i < 3; ++i) {
    const double end = entries[i - 1].pose.position[0] + entries[i - 1].summary.bounds_max[0] * entries[i - 1].scale;
    const double begin = entries[i].pose.position[0] + entries[i].summary.bounds_min[0] * entries[i].scale;
    EXPECT_NEAR(begin - end, 0.05, 1e-9);
  }
}

TEST_F(HostCoreTest, PublishesTheCatalogueAtFirstAndAfterALongPause) {
  HostCore host{kSelf, host_of("sphere", encoded_.compressed()), now_};

  EXPECT_TRUE(host.tick(now_).catalogue);
  EXPECT_FALSE(host.tick(now_ += 50 * kMs).catalogue);
  EXPECT_TRUE(host.tick(now_ += 6000 * kMs).catalogue);
}

TEST_F(HostCoreTest, WarnsOnceOfDamageInAFileThatAnHrtcNeeds) {
  const test_support::DamagedModel model{test_support::organ_of_several_blocks().compressed()};
  HostCore host{kSelf, host_of("organ", model.compressed()), now_};
  std::vector<std::string> warnings;
  host.on_event = [&](session::Severity severity, const std::string& text) {
    if (severity == session::Severity::kWarning) warnings.push_back(text);
  };
  session::Demand demand;
  demand.origin = {kSession, kHrtc, 1, now_};
  demand.object_id = session::id_of("organ");
  demand.digest = model.compressed().summary().digest;
  demand.serving_host = kHost;
  demand.epoch = 1;
  demand.stream = session::stream_id(kSelf, demand.origin, demand.object_id);
  demand.credit = 1u << 20;
  for (std::uint32_t region = 0; demand.wanted.size() < 3; ++region)
    if (model.is_damaged(region)) demand.wanted.push_back({region, 0});
  host.on_demand(demand, now_);
  for (int i = 0; i < 100; ++i, now_ += kMs) {
    while (host.next_chunk(now_)) continue;
    (void)host.tick(now_);
  }
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(
      warnings.front(),
      "object 'organ': organ.spm: section codes: the checksum of bytes 65536 to 131071 does not match, the file is "
      "damaged; parts of its surface stay coarse until the host serves a sound file");
}

TEST_F(HostCoreTest, AnswersClockRequestsOnlyAsTheTimeReferenceAndFailureDetectorsAlways) {
  HostCore host{kSelf, host_of("sphere", encoded_.compressed()), now_};
  (void)host.tick(now_);

  EXPECT_FALSE(host.on_clock(clock_request(now_), now_, now_));
  EXPECT_FALSE(host.on_failure_detector(clock_request(now_), now_, now_)) << "the sender is not in the roster";
  host.on_roster(hrtc_entry(), now_);
  const auto alive = host.on_failure_detector(clock_request(now_), now_, now_);
  ASSERT_TRUE(alive);
  EXPECT_EQ(alive->t2_ns, session::kClockUnknown);

  for (int i = 0; i < 120; ++i) (void)host.tick(now_ += 10 * kMs);  // the HRTC leaves the roster
  const auto answer = host.on_clock(clock_request(now_), now_ - kMs, now_);
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->peer, kHrtc);
  EXPECT_EQ(answer->t2_ns - answer->t1_ns, kMs);
}

TEST_F(HostCoreTest, PublishesPosesOnlyAfterItsClockFollowsTheSession) {
  constexpr std::int64_t kAhead = 5000 * kMs;  // session time minus the host's clock, ns
  HostCore host{kSelf, settings_with_body(), now_};
  std::size_t grants = 0, early_poses = 0, later_poses = 0;
  session::ObjectPose pose;

  for (int ms = 0; ms < 2000; ++ms, now_ += kMs) {
    if (ms % 100 == 0) host.on_roster(hrtc_entry(kHrtc, now_ + kAhead), now_);
    const HostMessages& messages = host.tick(now_);
    grants += messages.grants.size();
    (ms < 1000 ? early_poses : later_poses) += messages.poses.size();
    if (!messages.poses.empty()) pose = messages.poses.back();
    if (ms < 1000 || !messages.clock_request) continue;
    session::ClockSample answer = *messages.clock_request;
    answer.origin = {kSession, kHrtc, 1, 0};
    answer.peer = kHost;
    answer.answer = true;
    answer.t1_ns = answer.t2_ns = now_ + kAhead;
    EXPECT_FALSE(host.on_clock(answer, now_, now_));
  }

  EXPECT_GT(grants, 0u);
  EXPECT_EQ(early_poses, 0u);
  EXPECT_GT(later_poses, 0u);
  EXPECT_NEAR(static_cast<double>(pose.session_time_ns - pose.origin.time_ns), kAhead, 2 * kMs);
}

TEST_F(HostCoreTest, SendsHeartbeatsMoreOftenWhileAnotherHostServesItsMovableObject) {
  HostCore host{kSelf, settings_with_body(), now_};
  const auto heartbeats_in_3_s = [&] {
    std::size_t heartbeats = 0;
    const std::int64_t end_ns = now_ + 3000 * kMs;
    while (now_ < end_ns) {
      heartbeats += host.tick(now_).roster ? 1u : 0u;
      now_ = std::min(now_ + 50 * kMs, std::max(now_ + kMs, host.due_ns()));
    }
    return heartbeats;
  };
  session::CatalogueEntry other = host.catalogue().back();
  ASSERT_TRUE(sharing::can_move(other));
  other.origin = {kSession, kHost + 1, 1, 0};

  EXPECT_NEAR(static_cast<double>(heartbeats_in_3_s()), 30, 1);
  host.on_catalogue(other);
  EXPECT_NEAR(static_cast<double>(heartbeats_in_3_s()), 100, 5);
  other.withdrawn = true;
  host.on_catalogue(other);
  EXPECT_NEAR(static_cast<double>(heartbeats_in_3_s()), 30, 2);
}

TEST_F(HostCoreTest, MakesEndpointsForAViewerAtItsFirstDemandUntilItLeaves) {
  HostCore host{kSelf, host_of("sphere", encoded_.compressed()), now_};
  std::vector<std::string> receivers;
  host.on_receiver = [&](std::uint64_t, const std::string& name) { receivers.push_back(name); };
  host.on_receiver_gone = [&](std::uint64_t) { receivers.pop_back(); };
  session::RosterEntry viewer = hrtc_entry();
  viewer.role = session::Role::kViewer;
  viewer.name = "view";
  (void)host.tick(now_);
  host.on_roster(viewer, now_);
  EXPECT_THAT(receivers, testing::IsEmpty()) << "most viewers request no mesh";

  session::Demand demand;
  demand.origin = viewer.origin;
  demand.object_id = host.catalogue().front().object_id;
  demand.digest = model_.summary.digest;
  demand.serving_host = kHost;
  demand.epoch = 1;
  demand.need_base = true;
  demand.credit = 1u << 18;
  demand.stream = session::stream_id(kSelf, demand.origin, demand.object_id);
  host.on_demand(demand, now_);
  host.on_demand(demand, now_);
  EXPECT_THAT(receivers, testing::ElementsAre("view"));
  const auto chunk = host.next_chunk(now_);
  ASSERT_TRUE(chunk);
  EXPECT_EQ(chunk->hrtc, kHrtc);

  viewer.leaving = true;
  ++viewer.heartbeat;
  host.on_roster(viewer, now_);
  EXPECT_THAT(receivers, testing::IsEmpty());
}

TEST_F(HostCoreTest, CountsDemandsAndClaimsThatItRefuses) {
  HostCore host{kSelf, settings_with_body(), now_};
  const auto figure_of = [&](const char* name) {
    for (const session::Figure& figure : host.metrics(now_).figures)
      if (figure.name == name) return figure.value;
    return -1.0;
  };
  session::Demand demand;
  demand.origin = {kSession, kHrtc, 1, 0};
  demand.object_id = host.catalogue().front().object_id;
  demand.digest = model_.summary.digest;
  demand.have = {{model_.summary.regions, 1}};
  session::ObjectClaim claim;
  claim.object_id = demand.object_id;
  claim.touching = true;

  EXPECT_EQ(figure_of(session::figures::kHostDemandsRefused), 0);
  EXPECT_EQ(figure_of(session::figures::kHostClaimsRefused), 0);
  host.on_demand(demand, now_);
  for (std::uint64_t hrtc = 1; hrtc <= session::kMaxTouchers + 1; ++hrtc) {
    claim.origin = {kSession, 1000 + hrtc, 1, 0};
    host.on_claim(claim, now_);
  }

  EXPECT_EQ(figure_of(session::figures::kHostDemandsRefused), 1);
  EXPECT_EQ(figure_of(session::figures::kHostClaimsRefused), 1);
}

TEST_F(HostCoreTest, AcknowledgesAStopInTheNextTick) {
  HostCore host{kSelf, host_of("sphere", encoded_.compressed()), now_};
  ASSERT_TRUE(host.tick(now_).roster);
  ASSERT_FALSE(host.tick(now_ += kMs).roster);
  session::EmergencyStop stop;
  stop.origin = {kSession, 50, 1, 0};
  stop.number = 1;

  host.on_stop(stop);

  const auto& entry = host.tick(now_ += kMs).roster;
  ASSERT_TRUE(entry);
  EXPECT_TRUE(session::acknowledges(*entry, stop));
}

}  // namespace
}  // namespace tactus::host_service
