#include "session/stop_latch.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <random>
#include <variant>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;


Origin origin(std::uint64_t participant, std::uint64_t incarnation = 1) {
  return {kSession, participant, incarnation, 0};
}
StopName stop(std::uint64_t participant, std::uint32_t number = 1, std::uint64_t incarnation = 1) {
  return {participant, incarnation, number};
}
ForceReset reset(std::uint64_t participant, std::uint32_t number, std::vector<StopName> stops) {
  return {origin(participant), number, std::move(stops), ""};
}
RosterEntry entry(std::uint64_t participant, const StopLatch& latch) {
  RosterEntry result;
  result.origin = origin(participant);
  result.role = Role::kHrtc;
  result.name = std::to_string(participant);
  result.stops = latch.records();
  return result;
}

TEST(StopLatch, StandsUntilAResetNamesIt) {
  StopLatch latch{origin(1)};
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(latch.on_stop(stop(2)));
  EXPECT_TRUE(latch.on_reset(reset(3, 1, {stop(4)}))) << "the reset names another stop";
  EXPECT_TRUE(latch.stopped());
  EXPECT_TRUE(latch.on_reset(reset(3, 2, {stop(2)})));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, HoldsUntilEveryStopIsNamed) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(2));
  (void)latch.on_stop(stop(3));
  (void)latch.on_stop(stop(2, 1, 2));  // from a new incarnation of the issuer
  (void)latch.on_reset(reset(4, 1, {stop(2), stop(3)}));
  EXPECT_TRUE(latch.stopped());
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(1));
  (void)latch.on_reset(reset(4, 2, {stop(2, 1, 2)}));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, AResetThatArrivesBeforeItsStopEndsTheStop) {
  StopLatch latch{origin(1)};
  (void)latch.on_reset(reset(3, 1, {stop(2)}));
  EXPECT_FALSE(latch.on_stop(stop(2)));
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(latch.on_stop(stop(2, 2))) << "a later stop stands";
  EXPECT_TRUE(latch.stopped());
}

TEST(StopLatch, ARepeatedSampleChangesNothing) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(2));
  EXPECT_FALSE(latch.on_stop(stop(2)));
  (void)latch.on_reset(reset(3, 1, {stop(2)}));
  EXPECT_EQ(latch.resets(), 1u);
  const std::uint64_t changes = latch.changes();
  EXPECT_FALSE(latch.on_reset(reset(3, 1, {stop(2)}))) << "a repeated reset would end a later device fault";
  EXPECT_FALSE(latch.on_stop(stop(2)));
  EXPECT_FALSE(latch.stopped());
  EXPECT_EQ(latch.resets(), 1u);
  EXPECT_EQ(latch.changes(), changes);
}

TEST(StopLatch, TwoReorderedResetsEndBothStops) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(2));
  (void)latch.on_stop(stop(3));
  (void)latch.on_reset(reset(4, 2, {stop(3)}));
  (void)latch.on_reset(reset(4, 1, {stop(2)}));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, AppliesStopsFromTheRosterButNoResets) {
  StopLatch peer{origin(1)}, latch{origin(5)};
  (void)peer.on_stop(stop(2));
  EXPECT_TRUE(latch.on_roster(entry(1, peer)));
  EXPECT_TRUE(latch.stopped());
  EXPECT_FALSE(latch.on_roster(entry(1, peer)));
  (void)peer.on_reset(reset(3, 1, {stop(2)}));
  (void)latch.on_roster(entry(1, peer));
  EXPECT_TRUE(latch.stopped()) << "the sender of the roster entry may lack the right to reset";
  (void)latch.on_reset(reset(3, 1, {stop(2)}));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, IgnoresRosterEntriesOfAnotherSessionOrProtocolVersion) {
  StopLatch peer{origin(1)}, latch{origin(5)};
  (void)peer.on_stop(stop(2));
  RosterEntry other = entry(1, peer);
  other.origin.session = kSession + 1;
  EXPECT_FALSE(latch.on_roster(other));
  other = entry(1, peer);
  other.protocol = kProtocolVersion + 1;
  EXPECT_FALSE(latch.on_roster(other));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, DropsTheLeastRecentIssuerWithoutAStandingStopWhenFull) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(100));
  (void)latch.on_reset(reset(50, 1, {stop(100)}));
  for (std::uint64_t i = 0; i < kMaxStops - 3; ++i) (void)latch.on_stop(stop(200 + i));
  EXPECT_THAT(latch.records(), SizeIs(kMaxStops - 1));
  EXPECT_TRUE(latch.on_stop(stop(300)));
  const auto has_record_of = [&](std::uint64_t participant) {
    return std::any_of(latch.records().begin(), latch.records().end(),
                       [&](const StopRecord& record) { return record.participant == participant; });
  };
  EXPECT_FALSE(has_record_of(100));
  EXPECT_TRUE(has_record_of(50));
  EXPECT_TRUE(has_record_of(200));
  EXPECT_TRUE(has_record_of(300));
}

TEST(StopLatch, IssuesItsOwnStopWhenNoRecordIsFree) {
  StopLatch latch{origin(1)};
  std::vector<StopName> recorded;
  for (std::uint64_t i = 0; i < kMaxStops - 1; ++i) recorded.push_back(stop(100 + i));
  for (const StopName& name : recorded) (void)latch.on_stop(name);
  EXPECT_TRUE(latch.on_stop(stop(500)));
  EXPECT_FALSE(latch.on_stop(stop(500))) << "its own stop already stands";
  EXPECT_THAT(latch.records(), SizeIs(kMaxStops));

  EmergencyStop unrecorded;
  unrecorded.origin = origin(500);
  unrecorded.number = 1;
  EXPECT_TRUE(acknowledges(entry(1, latch), unrecorded)) << "the sender need not repeat the stop";
  (void)latch.on_reset(reset(3, 1, recorded));
  EXPECT_TRUE(latch.stopped()) << "the reset does not name the stop without a record";
  ASSERT_THAT(standing_stops(latch.records()), SizeIs(1));
  EXPECT_EQ(standing_stops(latch.records())[0].participant, 1u);
  (void)latch.on_reset(reset(3, 2, standing_stops(latch.records())));
  EXPECT_FALSE(latch.stopped());

  for (const StopName& name : recorded) (void)latch.on_stop({name.participant, 1, 2});
  EXPECT_TRUE(latch.on_stop(stop(501))) << "the latch issues its own stop a second time";
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(kMaxStops));
}

TEST(StopLatch, IgnoresStopsAndResetsUnderItsOwnName) {
  StopLatch latch{origin(1)};
  (void)latch.on_reset(reset(3, 1, {stop(1, 0xffffffff)}));
  EXPECT_FALSE(latch.on_stop(stop(1, 0xffffffff)));
  EXPECT_FALSE(latch.stopped());
  for (std::uint64_t i = 0; i < kMaxStops; ++i) (void)latch.on_stop(stop(100 + i));
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(kMaxStops));
}

TEST(StopLatch, ListsTheProgramsThatHaveAndHaveNotAcknowledged) {
  Roster roster{origin(99), {}};
  std::map<std::uint64_t, StopLatch> latches;
  std::uint64_t heartbeat = 0;
  const auto publish_roster = [&] {
    ++heartbeat;
    for (const auto& [id, latch] : latches) {
      RosterEntry published = entry(id, latch);
      published.role = id == 1 ? Role::kHost : id == 4 ? Role::kClient : Role::kHrtc;
      published.heartbeat = heartbeat;
      (void)roster.on_entry(published, 0);
    }
  };
  for (const std::uint64_t id : {1, 2, 3, 4}) latches.try_emplace(id, origin(id));
  EmergencyStop sent_stop;
  sent_stop.origin = origin(99);
  sent_stop.number = 1;
  (void)latches.at(1).on_stop(sent_stop.name());
  (void)latches.at(2).on_stop(sent_stop.name());
  publish_roster();
  Acknowledgement result = acknowledgement(roster, sent_stop);
  EXPECT_THAT(result.hosts, ElementsAre("1"));
  EXPECT_THAT(result.hrtcs, ElementsAre("2"));
  EXPECT_THAT(result.missing, ElementsAre("3")) << "a client has no forces";

  const ForceReset sent_reset = reset(98, 1, {sent_stop.name()});
  (void)latches.at(2).on_reset(sent_reset);
  (void)latches.at(3).on_reset(sent_reset);
  publish_roster();
  result = acknowledgement(roster, sent_reset);
  EXPECT_THAT(result.hrtcs, ElementsAre("2", "3")) << "the late stop will not stop HRTC 3";
  EXPECT_THAT(result.missing, ElementsAre("1"));
  EXPECT_THAT(acknowledgement(roster, sent_stop).missing, ElementsAre("3"));
  (void)latches.at(3).on_stop(sent_stop.name());
  publish_roster();
  EXPECT_THAT(acknowledgement(roster, sent_stop).missing, IsEmpty()) << "a stop that was reset also counts as received";
}

/// Simulates HRTCs, issuers of stops and operators who send resets, over a network that loses, duplicates and reorders
/// samples. A sender repeats its sample until all HRTCs have acknowledged it. An issuer may stop running before that,
/// an operator may not.
class StopSimulation {
 public:
  explicit StopSimulation(std::uint32_t seed) : random_{seed} {
    for (std::uint64_t id = 1; id <= kHrtcs; ++id) start_hrtc(id);
  }

  void run(bool restarts) {
    for (int step = 0; step < 400; ++step) {
      if (chance(0.05)) issue_stop();
      if (chance(0.05)) issue_reset(0.7);
      if (chance(0.05)) kill_an_issuer();
      if (restarts && chance(0.05)) restart_an_hrtc();
      publish();
      deliver(12);
    }
    deliver_all();
  }
  void reset_all_stops() {
    issue_reset(1);
    deliver_all();
  }

  [[nodiscard]] bool every_stop_was_named() const {
    return std::all_of(newest_received_.begin(), newest_received_.end(), [this](const auto& stop) {
      const auto named = newest_named_.find(stop.first);
      return named != newest_named_.end() && named->second >= stop.second;
    });
  }
  [[nodiscard]] std::size_t hrtcs_with_forces() const {
    return static_cast<std::size_t>(
        std::count_if(hrtcs_.begin(), hrtcs_.end(), [](const auto& hrtc) { return !hrtc.second.stopped(); }));
  }
  [[nodiscard]] bool all_senders_are_done() const { return stops_.empty() && resets_.empty(); }

  static constexpr std::uint64_t kHrtcs = 4;

 private:
  using Issuer = std::pair<std::uint64_t, std::uint64_t>;  // participant, incarnation
  struct Packet {
    std::uint64_t to;
    std::variant<EmergencyStop, ForceReset, RosterEntry> sample;
  };

  bool chance(double probability) { return std::uniform_real_distribution<>{}(random_) < probability; }
  std::ptrdiff_t random_below(std::size_t bound) {
    return std::uniform_int_distribution<std::ptrdiff_t>{0, static_cast<std::ptrdiff_t>(bound) - 1}(random_);
  }

  void start_hrtc(std::uint64_t id) {
    ++incarnation_;
    hrtcs_.insert_or_assign(id, StopLatch{origin(id, incarnation_)});
  }
  [[nodiscard]] bool stands_at_another_hrtc(const StopName& stop, std::uint64_t id) const {
    return std::any_of(hrtcs_.begin(), hrtcs_.end(), [&](const auto& hrtc) {
      const std::vector<StopName> stops = standing_stops(hrtc.second.records());
      return hrtc.first != id && std::any_of(stops.begin(), stops.end(), [&](const StopName& other) {
               return other.participant == stop.participant && other.number >= stop.number;
             });
    });
  }
  /// Restarts a random HRTC. Spares an HRTC with the only record of a stop, which would be lost.
  void restart_an_hrtc() {
    const std::uint64_t id = 1 + static_cast<std::uint64_t>(random_below(kHrtcs));
    const std::vector<StopName> stops = standing_stops(hrtcs_.at(id).records());
    if (std::all_of(stops.begin(), stops.end(), [&](const StopName& stop) { return stands_at_another_hrtc(stop, id); }))
      start_hrtc(id);
  }

  /// Issues a further stop of an issuer, or the first stop of a new issuer. Makes no more senders than a StopLatch has
  /// records.
  void issue_stop() {
    if (!stops_.empty() && chance(0.3)) {
      ++stops_[static_cast<std::size_t>(random_below(stops_.size()))].number;
    } else if (senders_ < kMaxStops - 3) {
      stops_.push_back({origin(100 + senders_++), 1, ""});
    }
  }
  void kill_an_issuer() {
    if (!stops_.empty()) stops_.erase(stops_.begin() + random_below(stops_.size()));
  }
  /// Sends a reset that names a share of the standing stops, and sometimes stops that no HRTC has received yet.
  void issue_reset(double share) {
    if (share < 1 && senders_ >= kMaxStops - 3) return;
    ForceReset sent = reset(100 + senders_++, 1, {});
    for (const auto& [id, hrtc] : hrtcs_)
      for (const StopName& stop : standing_stops(hrtc.records()))
        if (chance(share)) sent.stops.push_back(stop);
    for (const EmergencyStop& stop : stops_)
      if (chance(0.2)) sent.stops.push_back(stop.name());
    for (const StopName& stop : sent.stops) {
      std::uint32_t& newest = newest_named_[{stop.participant, stop.incarnation}];
      newest = std::max(newest, stop.number);
    }
    resets_.push_back(sent);
  }

  template <class Sample>
  void send(std::uint64_t to, const Sample& sample) {
    const int copies = chance(loss_) ? 0 : chance(0.2) ? 2 : 1;
    for (int i = 0; i < copies; ++i) network_.push_back({to, sample});
  }
  /// Drops the samples that all HRTCs have acknowledged and sends the others again.
  template <class Sample>
  void repeat(std::vector<Sample>& samples) {
    samples.erase(std::remove_if(samples.begin(), samples.end(),
                                 [this](const Sample& sample) {
                                   return std::all_of(hrtcs_.begin(), hrtcs_.end(), [&](const auto& hrtc) {
                                     return acknowledges(entry(hrtc.first, hrtc.second), sample);
                                   });
                                 }),
                  samples.end());
    for (const Sample& sample : samples)
      for (const auto& [id, hrtc] : hrtcs_) send(id, sample);
  }
  void publish() {
    for (const auto& [from, hrtc] : hrtcs_)
      for (std::uint64_t to = 1; to <= kHrtcs; ++to)
        if (from != to) send(to, entry(from, hrtc));
    repeat(stops_);
    repeat(resets_);
  }

  void receive(StopLatch& latch, const EmergencyStop& stop) {
    (void)latch.on_stop(stop.name());
    std::uint32_t& newest = newest_received_[{stop.origin.participant, stop.origin.incarnation}];
    newest = std::max(newest, stop.number);
  }
  void receive(StopLatch& latch, const ForceReset& reset) { (void)latch.on_reset(reset); }
  void receive(StopLatch& latch, const RosterEntry& entry) { (void)latch.on_roster(entry); }
  void deliver(std::size_t count) {
    for (; count > 0 && !network_.empty(); --count) {
      std::swap(network_[static_cast<std::size_t>(random_below(network_.size()))], network_.back());
      const Packet packet = network_.back();
      network_.pop_back();
      std::visit([&](const auto& sample) { receive(hrtcs_.at(packet.to), sample); }, packet.sample);
    }
  }
  /// Ends all losses and delivers all packets.
  void deliver_all() {
    loss_ = 0;
    for (int round = 0; round < 10; ++round) {
      publish();
      deliver(network_.size());
    }
  }

  std::mt19937 random_;
  double loss_ = 0.3;
  std::map<std::uint64_t, StopLatch> hrtcs_;
  std::vector<EmergencyStop> stops_;  // of issuers that run
  std::vector<ForceReset> resets_;
  std::vector<Packet> network_;
  std::map<Issuer, std::uint32_t> newest_received_;  // number of the newest stop that an HRTC has received
  std::map<Issuer, std::uint32_t> newest_named_;     // number of the newest stop that a reset has named
  std::uint64_t senders_ = 0;                        // of stops and resets
  std::uint64_t incarnation_ = 0;
};

TEST(StopSimulation, ForcesAreOnIfAndOnlyIfEveryStopWasNamedByAReset) {
  int seeds_with_forces = 0, seeds_without_forces = 0;
  for (std::uint32_t seed = 1; seed <= 300; ++seed) {
    StopSimulation simulation{seed};
    simulation.run(false);
    ASSERT_TRUE(simulation.all_senders_are_done()) << "seed " << seed;
    const bool named = simulation.every_stop_was_named();
    ASSERT_EQ(simulation.hrtcs_with_forces(), named ? StopSimulation::kHrtcs : 0) << "seed " << seed;
    ++(named ? seeds_with_forces : seeds_without_forces);
    simulation.reset_all_stops();
    ASSERT_EQ(simulation.hrtcs_with_forces(), StopSimulation::kHrtcs) << "seed " << seed;
  }
  EXPECT_GT(seeds_with_forces, 10);
  EXPECT_GT(seeds_without_forces, 10);
}

TEST(StopSimulation, NoForceIsOnWithoutAResetWhileHrtcsRestart) {
  int seeds_without_forces = 0;
  for (std::uint32_t seed = 1; seed <= 300; ++seed) {
    StopSimulation simulation{seed};
    simulation.run(true);
    if (!simulation.every_stop_was_named()) {
      ASSERT_EQ(simulation.hrtcs_with_forces(), 0u) << "seed " << seed;
      ++seeds_without_forces;
    }
    simulation.reset_all_stops();
    ASSERT_EQ(simulation.hrtcs_with_forces(), StopSimulation::kHrtcs) << "seed " << seed;
  }
  EXPECT_GT(seeds_without_forces, 10);
}

}  // namespace
}  // namespace tactus::session
