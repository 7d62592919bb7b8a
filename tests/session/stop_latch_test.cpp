#include "session/stop_latch.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <random>
#include <variant>

namespace tactus::session {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

constexpr std::uint64_t kSession = 7;

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
  RosterEntry made;
  made.origin = origin(participant);
  made.role = Role::kHrtc;
  made.name = std::to_string(participant);
  made.stops = latch.records();
  return made;
}

TEST(StopLatch, StandsUntilAResetNamesIt) {
  StopLatch latch{origin(1)};
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(latch.on_stop(stop(2)));
  EXPECT_TRUE(latch.on_reset(reset(3, 1, {stop(4)}))) << "names another stop";
  EXPECT_TRUE(latch.stopped());
  EXPECT_TRUE(latch.on_reset(reset(3, 2, {stop(2)})));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, HoldsUntilEveryStopIsNamed) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(2));
  (void)latch.on_stop(stop(3));
  (void)latch.on_stop(stop(2, 1, 2));  // the issuer has restarted
  (void)latch.on_reset(reset(4, 1, {stop(2), stop(3)}));
  EXPECT_TRUE(latch.stopped());
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(1));
  (void)latch.on_reset(reset(4, 2, {stop(2, 1, 2)}));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, AResetThatArrivesBeforeItsStopEndsIt) {
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
  EXPECT_FALSE(latch.on_reset(reset(3, 1, {stop(2)}))) << "it would reset a later device fault";
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

TEST(StopLatch, TakesStopsOverFromTheRosterButNoResets) {
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

TEST(StopLatch, TakesNothingFromAnotherSessionOrProtocol) {
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

TEST(StopLatch, WhenFullDropsTheLeastRecentIssuerWithoutAStandingStop) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(100));
  (void)latch.on_reset(reset(50, 1, {stop(100)}));
  for (std::uint64_t i = 0; i < kMaxStops - 3; ++i) (void)latch.on_stop(stop(200 + i));
  EXPECT_THAT(latch.records(), SizeIs(kMaxStops - 1));
  EXPECT_TRUE(latch.on_stop(stop(300)));
  const auto knows = [&](std::uint64_t participant) {
    return std::any_of(latch.records().begin(), latch.records().end(),
                       [&](const StopRecord& record) { return record.participant == participant; });
  };
  EXPECT_FALSE(knows(100));
  EXPECT_TRUE(knows(50));
  EXPECT_TRUE(knows(200));
  EXPECT_TRUE(knows(300));
}

TEST(StopLatch, RaisesItsOwnStopWhenNoRecordIsFree) {
  StopLatch latch{origin(1)};
  std::vector<StopName> known;
  for (std::uint64_t i = 0; i < kMaxStops - 1; ++i) known.push_back(stop(100 + i));
  for (const StopName& name : known) (void)latch.on_stop(name);
  EXPECT_TRUE(latch.on_stop(stop(500)));
  EXPECT_FALSE(latch.on_stop(stop(500))) << "already stopped";
  EXPECT_THAT(latch.records(), SizeIs(kMaxStops));

  EmergencyStop lost;
  lost.origin = origin(500);
  lost.number = 1;
  EXPECT_TRUE(acknowledges(entry(1, latch), lost)) << "its sender need not repeat it";
  (void)latch.on_reset(reset(3, 1, known));
  EXPECT_TRUE(latch.stopped()) << "a stop has no record";
  ASSERT_THAT(standing_stops(latch.records()), SizeIs(1));
  EXPECT_EQ(standing_stops(latch.records())[0].participant, 1u);
  (void)latch.on_reset(reset(3, 2, standing_stops(latch.records())));
  EXPECT_FALSE(latch.stopped());

  for (const StopName& name : known) (void)latch.on_stop({name.participant, 1, 2});
  EXPECT_TRUE(latch.on_stop(stop(501))) << "once more";
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(kMaxStops));
}

TEST(StopLatch, OnlyThisProgramIssuesItsStops) {
  StopLatch latch{origin(1)};
  (void)latch.on_reset(reset(3, 1, {stop(1, 0xffffffff)}));
  EXPECT_FALSE(latch.on_stop(stop(1, 0xffffffff)));
  EXPECT_FALSE(latch.stopped());
  for (std::uint64_t i = 0; i < kMaxStops; ++i) (void)latch.on_stop(stop(100 + i));
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(kMaxStops));
}

TEST(StopLatch, ListsAcknowledgedAndMissingPrograms) {
  Roster roster{origin(99), {}};
  std::map<std::uint64_t, StopLatch> latches;
  std::uint64_t heartbeat = 0;
  const auto beat = [&] {
    ++heartbeat;
    for (const auto& [id, latch] : latches) {
      RosterEntry made = entry(id, latch);
      made.role = id == 1 ? Role::kHost : id == 4 ? Role::kClient : Role::kHrtc;
      made.heartbeat = heartbeat;
      (void)roster.on_entry(made, 0);
    }
  };
  for (const std::uint64_t id : {1, 2, 3, 4}) latches.try_emplace(id, origin(id));
  EmergencyStop sent;
  sent.origin = origin(99);
  sent.number = 1;
  (void)latches.at(1).on_stop(sent.name());
  (void)latches.at(2).on_stop(sent.name());
  beat();
  Acknowledgement answer = acknowledgement(roster, sent);
  EXPECT_THAT(answer.hosts, ElementsAre("1"));
  EXPECT_THAT(answer.hrtcs, ElementsAre("2"));
  EXPECT_THAT(answer.missing, ElementsAre("3")) << "a client has no forces";

  const ForceReset end = reset(98, 1, {sent.name()});
  (void)latches.at(2).on_reset(end);
  (void)latches.at(3).on_reset(end);
  beat();
  answer = acknowledgement(roster, end);
  EXPECT_THAT(answer.hrtcs, ElementsAre("2", "3")) << "3 will not stop when the stop arrives";
  EXPECT_THAT(answer.missing, ElementsAre("1"));
  EXPECT_THAT(acknowledgement(roster, sent).missing, ElementsAre("3"));
  (void)latches.at(3).on_stop(sent.name());
  beat();
  EXPECT_THAT(acknowledgement(roster, sent).missing, IsEmpty()) << "a stop that was reset also counts as received";
}

/// HRTCs, issuers of stops, and operators who reset, over a network that loses, repeats and reorders. Senders repeat
/// a sample until all have acknowledged it. Issuers may end before that; operators do not.
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
    quiet_down();
  }
  void reset_everything() {
    issue_reset(1);
    quiet_down();
  }

  [[nodiscard]] bool every_stop_was_named() const {
    return std::all_of(reached_.begin(), reached_.end(), [this](const auto& stop) {
      const auto named = named_.find(stop.first);
      return named != named_.end() && named->second >= stop.second;
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

  bool chance(double p) { return std::uniform_real_distribution<>{}(random_) < p; }
  std::ptrdiff_t below(std::size_t n) {
    return std::uniform_int_distribution<std::ptrdiff_t>{0, static_cast<std::ptrdiff_t>(n) - 1}(random_);
  }

  void start_hrtc(std::uint64_t id) {
    ++incarnation_;
    hrtcs_.insert_or_assign(id, StopLatch{origin(id, incarnation_)});
  }
  [[nodiscard]] bool stands_elsewhere(const StopName& stop, std::uint64_t than) const {
    return std::any_of(hrtcs_.begin(), hrtcs_.end(), [&](const auto& hrtc) {
      const std::vector<StopName> there = standing_stops(hrtc.second.records());
      return hrtc.first != than && std::any_of(there.begin(), there.end(), [&](const StopName& other) {
               return other.participant == stop.participant && other.number >= stop.number;
             });
    });
  }
  /// Spares an HRTC with the only record of a stop: after its restart nobody could enforce that stop.
  void restart_an_hrtc() {
    const std::uint64_t id = 1 + static_cast<std::uint64_t>(below(kHrtcs));
    const std::vector<StopName> known = standing_stops(hrtcs_.at(id).records());
    if (std::all_of(known.begin(), known.end(), [&](const StopName& stop) { return stands_elsewhere(stop, id); }))
      start_hrtc(id);
  }

  /// A stop of a new issuer, or a further one of an issuer. No more issuers than a StopLatch records.
  void issue_stop() {
    if (!stops_.empty() && chance(0.3)) {
      ++stops_[static_cast<std::size_t>(below(stops_.size()))].number;
    } else if (senders_ < kMaxStops - 3) {
      stops_.push_back({origin(100 + senders_++), 1, ""});
    }
  }
  void kill_an_issuer() {
    if (!stops_.empty()) stops_.erase(stops_.begin() + below(stops_.size()));
  }
  /// Names a share of the standing stops, and sometimes a stop that has reached nobody yet.
  void issue_reset(double share) {
    if (share < 1 && senders_ >= kMaxStops - 3) return;
    ForceReset made = reset(100 + senders_++, 1, {});
    for (const auto& [id, hrtc] : hrtcs_)
      for (const StopName& stop : standing_stops(hrtc.records()))
        if (chance(share)) made.stops.push_back(stop);
    for (const EmergencyStop& stop : stops_)
      if (chance(0.2)) made.stops.push_back(stop.name());
    for (const StopName& stop : made.stops) {
      std::uint32_t& named = named_[{stop.participant, stop.incarnation}];
      named = std::max(named, stop.number);
    }
    resets_.push_back(made);
  }

  template <class Sample>
  void send(std::uint64_t to, const Sample& sample) {
    const int copies = chance(loss_) ? 0 : chance(0.2) ? 2 : 1;
    for (int i = 0; i < copies; ++i) network_.push_back({to, sample});
  }
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

  void take(StopLatch& at, const EmergencyStop& stop) {
    (void)at.on_stop(stop.name());
    std::uint32_t& reached = reached_[{stop.origin.participant, stop.origin.incarnation}];
    reached = std::max(reached, stop.number);
  }
  void take(StopLatch& at, const ForceReset& reset) { (void)at.on_reset(reset); }
  void take(StopLatch& at, const RosterEntry& entry) { (void)at.on_roster(entry); }
  void deliver(std::size_t count) {
    for (; count > 0 && !network_.empty(); --count) {
      std::swap(network_[static_cast<std::size_t>(below(network_.size()))], network_.back());
      const Packet packet = network_.back();
      network_.pop_back();
      std::visit([&](const auto& sample) { take(hrtcs_.at(packet.to), sample); }, packet.sample);
    }
  }
  /// Delivers all packets without further loss.
  void quiet_down() {
    loss_ = 0;
    for (int round = 0; round < 10; ++round) {
      publish();
      deliver(network_.size());
    }
  }

  std::mt19937 random_;
  double loss_ = 0.3;
  std::map<std::uint64_t, StopLatch> hrtcs_;
  std::vector<EmergencyStop> stops_;  // of senders that live
  std::vector<ForceReset> resets_;
  std::vector<Packet> network_;
  std::map<Issuer, std::uint32_t> reached_;  // newest stop that has reached an HRTC
  std::map<Issuer, std::uint32_t> named_;    // newest stop that a reset has named
  std::uint64_t senders_ = 0;
  std::uint64_t incarnation_ = 0;
};

TEST(StopSimulation, ForcesAreOnIfAndOnlyIfEveryStopWasNamedByAReset) {
  int on = 0, off = 0;
  for (std::uint32_t seed = 1; seed <= 300; ++seed) {
    StopSimulation session{seed};
    session.run(false);
    ASSERT_TRUE(session.all_senders_are_done()) << "seed " << seed;
    const bool named = session.every_stop_was_named();
    ASSERT_EQ(session.hrtcs_with_forces(), named ? StopSimulation::kHrtcs : 0) << "seed " << seed;
    ++(named ? on : off);
    session.reset_everything();
    ASSERT_EQ(session.hrtcs_with_forces(), StopSimulation::kHrtcs) << "seed " << seed;
  }
  EXPECT_GT(on, 10);
  EXPECT_GT(off, 10);
}

TEST(StopSimulation, NoForceIsOnWithoutAResetWhileHrtcsRestart) {
  int off = 0;
  for (std::uint32_t seed = 1; seed <= 300; ++seed) {
    StopSimulation session{seed};
    session.run(true);
    if (!session.every_stop_was_named()) {
      ASSERT_EQ(session.hrtcs_with_forces(), 0u) << "seed " << seed;
      ++off;
    }
    session.reset_everything();
    ASSERT_EQ(session.hrtcs_with_forces(), StopSimulation::kHrtcs) << "seed " << seed;
  }
  EXPECT_GT(off, 10);
}

}  // namespace
}  // namespace tactus::session
