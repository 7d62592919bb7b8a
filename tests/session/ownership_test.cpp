#include "session/ownership.hpp"

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <queue>
#include <random>
#include <set>
#include <variant>

namespace tactus::session {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint64_t kSession = 1, kObject = 5, kHost = 100;
/// Between the incarnations of a host, which are nanoseconds: more than the numbers that one incarnation grants.
constexpr std::uint64_t kHostLife = 1'000'000;
constexpr std::size_t kHrtcs = 4;

Origin origin_of(std::uint64_t participant, std::uint64_t incarnation) {
  Origin origin;
  origin.session = kSession;
  origin.participant = participant;
  origin.incarnation = incarnation;
  return origin;
}

struct ContestFaults {
  double loss = 0, repeated = 0;
  std::int64_t delay_ms = 5, spread_ms = 0;
};

/// A host, HRTCs and a viewer over a network that loses, repeats and reorders; owners and leaders publish poses.
class Contest {
 public:
  explicit Contest(unsigned seed, const ContestFaults& faults = {}) : faults_{faults}, random_{seed} {
    start_host();
    for (std::size_t i = 0; i < kHrtcs; ++i) start_hrtc(i);
    pose_admissions_.resize(kHrtcs + 2);  // HRTCs, host, viewer
  }

  void start_host() {
    host_ =
        std::make_unique<OwnershipArbiter>(origin_of(kHost, ++host_incarnation_ * kHostLife), kObject, settings_, now_);
    host_ran_ = true;
  }
  void start_hrtc(std::size_t i) {
    hrtcs_[i].incarnation = ++incarnations_;
    hrtcs_[i].claimant = std::make_unique<Claimant>(origin_of(i + 1, incarnations_), kObject, settings_);
    hrtcs_[i].sequence = 0;
    hrtcs_[i].role_before = Claimant::Role::kWatching;
  }

  Claimant& claimant(std::size_t i) { return *hrtcs_[i].claimant; }
  Claimant::Role role(std::size_t i) { return hrtcs_[i].claimant->role(now_); }
  OwnershipArbiter& host() { return *host_; }
  /// Disconnects a program until this time.
  void disconnect(std::size_t program, std::int64_t until) { cut_[program] = until; }
  /// Suspends an HRTC until this time. Then it publishes once more before it reads the samples that arrived.
  void suspend(std::size_t i, std::int64_t until) {
    hrtcs_[i].suspended_until = until;
    hrtcs_[i].role_before = role(i);
    hrtcs_[i].fencing_before = claimant(i).fencing();
  }
  void set_faults(const ContestFaults& faults) { faults_ = faults; }

  void run(std::int64_t ms) {
    for (const std::int64_t end = now_ + ms * kMs; now_ < end;) step();
  }

  /// Checks the invariants.
  void check() const {
    for (const auto& [fencing, authors] : authors_)
      ASSERT_LE(authors.size(), 1u) << "poses of two owners were accepted under fencing number " << fencing;
    if (host_incarnation_ > 1) return;  // a restarted host may overlap with a lease, under another number
    int owners = host_->host_simulates(now_) ? 1 : 0;
    for (const Hrtc& hrtc : hrtcs_) {
      const Claimant::Role role = hrtc.claimant->role(now_);
      if (role == Claimant::Role::kOwner && hrtc.suspended_until <= now_) ++owners;
    }
    ASSERT_LE(owners, 1) << "at " << now_ / kMs << " ms";
  }

  [[nodiscard]] std::uint64_t refused() const { return refused_; }
  [[nodiscard]] std::int64_t now() const { return now_; }
  /// When the viewer last accepted a pose.
  [[nodiscard]] std::int64_t seen_ns() const { return seen_ns_; }
  [[nodiscard]] std::uint64_t seen_author() const { return seen_author_; }

 private:
  using Message = std::variant<ObjectClaim, ObjectGrant, ObjectPose>;
  struct Packet {
    std::int64_t at;
    std::uint64_t order;
    std::size_t to;
    Message message;
    bool operator>(const Packet& o) const { return at != o.at ? at > o.at : order > o.order; }
  };
  struct Hrtc {
    std::unique_ptr<Claimant> claimant;
    std::uint64_t incarnation = 0;
    std::uint32_t sequence = 0;
    std::int64_t suspended_until = 0;
    Claimant::Role role_before = Claimant::Role::kWatching;
    std::uint64_t fencing_before = 0;
  };
  static constexpr std::size_t kHostIndex = kHrtcs, kViewer = kHrtcs + 1;

  double uniform() { return std::uniform_real_distribution<double>{0, 1}(random_); }
  [[nodiscard]] bool cut(std::size_t program) const {
    const auto at = cut_.find(program);
    return at != cut_.end() && at->second > now_;
  }

  void send(std::size_t from, std::size_t to, const Message& message) {
    if (cut(from) || cut(to) || uniform() < faults_.loss) return;
    for (int times = uniform() < faults_.repeated ? 2 : 1; times > 0; --times) {
      const auto spread = static_cast<std::int64_t>(uniform() * static_cast<double>(faults_.spread_ms * kMs));
      in_flight_.push({now_ + faults_.delay_ms * kMs + spread, ++order_, to, message});
    }
  }
  void publish(std::size_t from, std::uint64_t participant, std::uint64_t incarnation, std::uint64_t fencing,
               std::uint32_t& sequence) {
    ObjectPose pose;
    pose.origin = origin_of(participant, incarnation);
    pose.object_id = kObject;
    pose.fencing = fencing;
    pose.sequence = ++sequence;
    for (std::size_t to = 0; to <= kViewer; ++to) {
      if (to != from) send(from, to, pose);
    }
  }

  void receive(const Packet& packet) {
    if (const auto* claim = std::get_if<ObjectClaim>(&packet.message)) {
      if (host_ran_) host_->on_claim(*claim, now_);
    } else if (const auto* grant = std::get_if<ObjectGrant>(&packet.message)) {
      hrtcs_[packet.to].claimant->on_grant(*grant, now_);
    } else if (const auto* pose = std::get_if<ObjectPose>(&packet.message)) {
      if (!pose_admissions_[packet.to].accept(*pose, now_)) {
        if (pose->fencing < pose_admissions_[packet.to].fencing()) ++refused_;
        return;
      }
      authors_[pose->fencing].insert({pose->origin.participant, pose->origin.incarnation});
      if (packet.to == kHostIndex) host_->on_pose(pose->fencing, now_);
      if (packet.to < kHrtcs) hrtcs_[packet.to].claimant->on_pose(pose->fencing, now_);
      if (packet.to == kViewer) {
        seen_ns_ = now_;
        seen_author_ = pose->origin.participant;
      }
    }
  }

  void step() {
    now_ += kMs;
    std::vector<Packet> later;
    while (!in_flight_.empty() && in_flight_.top().at <= now_) {
      const Packet packet = in_flight_.top();
      in_flight_.pop();
      if (packet.to < kHrtcs && hrtcs_[packet.to].suspended_until > now_) {
        later.push_back(packet);  // waits in the queue of the suspended program
        later.back().at = hrtcs_[packet.to].suspended_until + kMs;
        continue;
      }
      receive(packet);
    }
    for (const Packet& packet : later) in_flight_.push(packet);

    for (std::size_t i = 0; i < kHrtcs; ++i) {
      Hrtc& hrtc = hrtcs_[i];
      if (hrtc.suspended_until > now_) continue;
      if (hrtc.suspended_until == now_ && hrtc.role_before == Claimant::Role::kOwner) {
        publish(i, i + 1, hrtc.incarnation, hrtc.fencing_before, hrtc.sequence);
      }
      if (const auto claim = hrtc.claimant->tick(now_)) send(i, kHostIndex, *claim);
      const Claimant::Role role = hrtc.claimant->role(now_);
      if (role == Claimant::Role::kOwner || role == Claimant::Role::kLeader)
        publish(i, i + 1, hrtc.incarnation, hrtc.claimant->fencing(), hrtc.sequence);
    }
    if (const auto grant = host_->tick(now_)) {
      for (std::size_t i = 0; i < kHrtcs; ++i) send(kHostIndex, i, *grant);
    }
    if (host_->host_simulates(now_))
      publish(kHostIndex, kHost, host_incarnation_ * kHostLife, host_->fencing(), host_sequence_);
  }

  OwnershipSettings settings_;
  ContestFaults faults_;
  std::mt19937 random_;
  std::int64_t now_ = 0;
  std::unique_ptr<OwnershipArbiter> host_;
  bool host_ran_ = false;
  std::uint64_t host_incarnation_ = 0, incarnations_ = 0, order_ = 0, refused_ = 0;
  std::uint32_t host_sequence_ = 0;
  std::array<Hrtc, kHrtcs> hrtcs_;
  std::vector<PoseAdmission> pose_admissions_;
  std::priority_queue<Packet, std::vector<Packet>, std::greater<>> in_flight_;
  std::map<std::size_t, std::int64_t> cut_;
  std::map<std::uint64_t, std::set<std::pair<std::uint64_t, std::uint64_t>>> authors_;
  std::int64_t seen_ns_ = 0;
  std::uint64_t seen_author_ = 0;
};

TEST(Ownership, TheHostOwnsBeforeAndAfterATouch) {
  Contest contest{1};
  contest.run(300);
  EXPECT_EQ(contest.seen_author(), kHost);
  contest.claimant(0).set_touching(true);
  EXPECT_EQ(contest.role(0), Claimant::Role::kRequesting);
  contest.run(30);
  EXPECT_EQ(contest.role(0), Claimant::Role::kOwner);
  EXPECT_EQ(contest.seen_author(), 1u);
  EXPECT_FALSE(contest.host().host_simulates(contest.now()));
  contest.claimant(0).set_touching(false);
  EXPECT_EQ(contest.role(0), Claimant::Role::kWatching);
  contest.run(30);
  EXPECT_EQ(contest.seen_author(), kHost);
}

TEST(Ownership, TwoTouchersSimulateCopiesAndTheLongestHolderLeads) {
  Contest contest{1};
  contest.run(300);
  contest.claimant(2).set_one_way(40 * kMs);
  contest.claimant(2).set_touching(true);
  contest.run(30);
  const std::uint64_t alone = contest.claimant(2).fencing();
  contest.claimant(1).set_touching(true);
  contest.run(30);
  EXPECT_EQ(contest.role(2), Claimant::Role::kLeader);
  EXPECT_EQ(contest.role(1), Claimant::Role::kCopy);
  EXPECT_GT(contest.claimant(1).fencing(), alone);
  EXPECT_EQ(contest.claimant(1).grant().channel_delay_ns, 40 * kMs);
  EXPECT_NE(contest.claimant(1).copy_index(), contest.claimant(2).copy_index());
  EXPECT_EQ(contest.seen_author(), 3u);
  contest.claimant(2).set_touching(false);
  contest.run(30);
  EXPECT_EQ(contest.role(1), Claimant::Role::kOwner);
  EXPECT_EQ(contest.seen_author(), 2u);
}

TEST(Ownership, ASuspendedOwnerLosesTheObjectAfterItsLeaseAndItsPosesAreRefused) {
  Contest contest{1};
  contest.run(300);
  contest.claimant(0).set_touching(true);
  contest.run(30);
  ASSERT_EQ(contest.role(0), Claimant::Role::kOwner);
  contest.suspend(0, contest.now() + 600 * kMs);
  contest.run(300);
  EXPECT_TRUE(contest.host().host_simulates(contest.now()));
  EXPECT_EQ(contest.seen_author(), kHost);
  const std::uint64_t before = contest.refused();
  contest.run(310);  // it resumes and sends one more pose
  EXPECT_GT(contest.refused(), before);
  contest.run(50);
  EXPECT_EQ(contest.role(0), Claimant::Role::kOwner);  // it still touches, so it gets a new grant
  contest.check();
}

TEST(Ownership, TheLeaseGrowsWithTheRoundTrip) {
  Contest contest{1, {0, 0, 300, 0}};
  contest.run(700);
  for (const std::size_t i : {0u, 1u}) contest.claimant(i).set_one_way(300 * kMs);
  contest.claimant(0).set_touching(true);
  contest.run(610);
  EXPECT_EQ(contest.role(0), Claimant::Role::kOwner);
  contest.run(1000);
  EXPECT_EQ(contest.role(0), Claimant::Role::kOwner) << "as long as it touches";
  contest.disconnect(0, contest.now() + 3000 * kMs);
  contest.run(850);
  EXPECT_EQ(contest.role(0), Claimant::Role::kRequesting);
  contest.run(400);
  EXPECT_TRUE(contest.host().host_simulates(contest.now()));
  contest.check();
}

TEST(Ownership, ADisconnectedOwnerStopsBeforeTheHostTakesTheObjectBack) {
  Contest contest{1};
  contest.run(300);
  contest.claimant(0).set_touching(true);
  contest.run(30);
  contest.disconnect(0, contest.now() + 1000 * kMs);
  std::int64_t stopped = 0, taken = 0;
  for (int ms = 0; ms < 500; ++ms) {
    contest.run(1);
    if (stopped == 0 && contest.role(0) != Claimant::Role::kOwner) stopped = contest.now();
    if (taken == 0 && contest.host().host_simulates(contest.now())) taken = contest.now();
  }
  ASSERT_GT(stopped, 0);
  ASSERT_GT(taken, 0);
  EXPECT_LE(stopped, taken);
}

TEST(Ownership, ARestartedHostGrantsALargerNumber) {
  Contest contest{1};
  contest.run(300);
  contest.claimant(0).set_touching(true);
  contest.run(30);
  contest.claimant(1).set_touching(true);
  contest.run(30);
  const std::uint64_t before = contest.claimant(0).fencing();
  contest.start_host();
  contest.run(400);
  EXPECT_GT(contest.claimant(0).fencing(), before);
  const std::set<Claimant::Role> roles{contest.role(0), contest.role(1)};
  EXPECT_EQ(roles, (std::set<Claimant::Role>{Claimant::Role::kLeader, Claimant::Role::kCopy}));
  contest.check();
}

TEST(Ownership, EachNumberHasOneOwnerUnderFaultsAndOneOwnerRemainsAfterThem) {
  std::uint64_t refused = 0;
  for (unsigned seed = 1; seed <= 150; ++seed) {
    std::mt19937 random{seed};
    const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
    ContestFaults faults;
    faults.loss = 0.01 * below(40);
    faults.repeated = 0.01 * below(30);
    faults.delay_ms = below(100);
    faults.spread_ms = below(80);
    Contest contest{seed, faults};
    std::array<bool, kHrtcs> touches{};
    for (int event = 0; event < 60; ++event) {
      const auto who = static_cast<std::size_t>(below(kHrtcs));
      switch (below(10)) {
        case 0:
          contest.disconnect(static_cast<std::size_t>(below(kHrtcs + 1)), contest.now() + below(600) * kMs);
          break;
        case 1:
          contest.suspend(who, contest.now() + below(500) * kMs);
          break;
        case 2:
          contest.start_hrtc(who);
          touches[who] = false;
          contest.claimant(who).set_one_way(below(400) * kMs);  // a wrong transit must not cause two owners
          break;
        case 3:
          if (seed % 3 == 0) contest.start_host();
          break;
        default:
          contest.claimant(who).set_touching(touches[who] = !touches[who]);
      }
      for (int ms = below(150); ms > 0; --ms) {
        contest.run(1);
        contest.check();
        if (HasFatalFailure()) FAIL() << "seed " << seed;
      }
    }
    refused += contest.refused();

    // All faults end; the touches remain.
    contest.set_faults({});
    for (std::size_t program = 0; program <= kHrtcs; ++program) contest.disconnect(program, 0);
    contest.run(2500);
    contest.check();
    int touching = 0, simulating = 0, leading = 0;
    for (std::size_t i = 0; i < kHrtcs; ++i) {
      touching += touches[i] ? 1 : 0;
      const Claimant::Role role = contest.role(i);
      if (role == Claimant::Role::kCopy || role == Claimant::Role::kLeader || role == Claimant::Role::kOwner)
        ++simulating;
      if (role == Claimant::Role::kLeader || role == Claimant::Role::kOwner) ++leading;
    }
    EXPECT_EQ(simulating, touching) << "seed " << seed;
    EXPECT_EQ(leading, touching > 0 ? 1 : 0) << "seed " << seed;
    EXPECT_EQ(contest.host().host_simulates(contest.now()), touching == 0) << "seed " << seed;
    EXPECT_GT(contest.seen_ns(), contest.now() - 50 * kMs) << "seed " << seed << ": nobody simulates the object";
    if (HasFailure()) return;
  }
  EXPECT_GT(refused, 100u);
}

TEST(PoseAdmission, RefusesAnOlderNumberAnOlderPoseAndASecondAuthor) {
  PoseAdmission admission;
  ObjectPose pose;
  pose.origin = origin_of(1, 1);
  pose.fencing = 3;
  pose.sequence = 7;
  EXPECT_TRUE(admission.accept(pose, 0));
  EXPECT_FALSE(admission.accept(pose, 0));
  pose.sequence = 6;
  EXPECT_FALSE(admission.accept(pose, 0));
  ObjectPose other = pose;
  other.origin = origin_of(2, 1);
  other.sequence = 9;
  EXPECT_FALSE(admission.accept(other, 0));
  other.fencing = 2;
  EXPECT_FALSE(admission.accept(other, 0));
  other.fencing = 4;
  other.sequence = 1;
  EXPECT_TRUE(admission.accept(other, 0));
  pose.sequence = 20;
  EXPECT_FALSE(admission.accept(pose, 0));
}

ObjectClaim claim_of(std::uint64_t participant, std::uint64_t incarnation, std::uint32_t sequence, bool touching) {
  ObjectClaim claim;
  claim.origin = origin_of(participant, incarnation);
  claim.object_id = kObject;
  claim.sequence = sequence;
  claim.touching = touching;
  return claim;
}

ObjectGrant grant_of(std::uint32_t sequence, std::uint64_t fencing) {
  ObjectGrant grant;
  grant.origin = origin_of(kHost, 1);
  grant.object_id = kObject;
  grant.sequence = sequence;
  grant.fencing = fencing;
  return grant;
}

TEST(OwnershipArbiter, GrantsAgainAfterOneClaimFromTheFarFuture) {
  for (const bool is_number : {true, false}) {
    OwnershipArbiter arbiter{origin_of(kHost, kHostLife), kObject, {}, 0};
    std::int64_t now = 300 * kMs;
    std::uint32_t sequence = 0;
    for (int i = 0; i < 10; ++i) arbiter.on_claim(claim_of(1, 3, ++sequence, true), now += 20 * kMs);
    const ObjectClaim wrong = is_number ? claim_of(1, 3, 0xffffffff, true) : claim_of(1, UINT64_MAX, ++sequence, true);
    arbiter.on_claim(wrong, now);
    for (int i = 0; i < 100; ++i) {
      arbiter.on_claim(claim_of(1, 3, ++sequence, true), now += 20 * kMs);
      (void)arbiter.tick(now);
    }
    ASSERT_FALSE(arbiter.host_simulates(now)) << "an HRTC touches";
    arbiter.on_claim(claim_of(1, 3, ++sequence, false), now += 20 * kMs);
    const std::optional<ObjectGrant> grant = arbiter.tick(now);
    ASSERT_TRUE(grant);
    EXPECT_TRUE(grant->touchers.empty()) << "it has let go";
  }
}

TEST(OwnershipArbiter, OneFencingNumberFromTheFarFutureIsNotTaken) {
  OwnershipArbiter arbiter{origin_of(kHost, kHostLife), kObject, {}, 0};
  std::int64_t now = 300 * kMs;
  (void)arbiter.tick(now);
  const std::uint64_t before = arbiter.fencing();
  ObjectClaim wrong = claim_of(1, 3, 1, false);
  wrong.fencing = UINT64_MAX;
  arbiter.on_claim(wrong, now);
  EXPECT_EQ(arbiter.fencing(), before);
}

TEST(Claimant, AcceptsGrantsAfterOneFromTheFarFuture) {
  for (const bool is_number : {true, false}) {
    Claimant claimant{origin_of(1, 1), kObject, {}};
    claimant.set_touching(true);
    std::int64_t now = 0;
    std::uint32_t sequence = 0;
    for (int i = 0; i < 100; ++i) {
      now += 20 * kMs;
      const std::optional<ObjectClaim> claim = claimant.tick(now);
      ASSERT_TRUE(claim);
      ObjectGrant grant = grant_of(++sequence, 7);
      if (i == 50) (is_number ? grant.sequence = 0xffffffff : grant.fencing = UINT64_MAX);
      grant.touchers = {{1, 1, claim->sequence}};
      claimant.on_grant(grant, now);
    }
    EXPECT_EQ(claimant.role(now), Claimant::Role::kOwner);
  }
}

TEST(PoseAdmission, GoesOnAfterOnePoseFromTheFarFuture) {
  for (const bool is_number : {true, false}) {
    PoseAdmission admission;
    ObjectPose pose;
    pose.origin = origin_of(1, 1);
    pose.fencing = 3;
    int accepted = 0;
    for (std::uint32_t i = 1; i <= 100; ++i) {
      ObjectPose sent = pose;
      sent.sequence = i;
      if (i == 50) (is_number ? sent.sequence = 0xffffffff : sent.fencing = UINT64_MAX);
      accepted += admission.accept(sent, i * 4 * kMs) ? 1 : 0;
    }
    EXPECT_EQ(accepted, 99);
  }
}

TEST(CopyAdmission, GoesOnAfterOneCopyFromTheFarFuture) {
  for (const bool is_number : {true, false}) {
    CopyAdmission admission;
    ObjectCopy copy;
    copy.origin = origin_of(2, 1);
    int taken = 0;
    for (std::uint32_t i = 1; i <= 100; ++i) {
      copy.sequence = i;
      copy.session_time_ns = i * kMs;
      if (i == 50) (is_number ? copy.sequence = 0xffffffff : copy.session_time_ns = INT64_MAX);
      taken += admission.accept(copy, i * kMs, i * kMs) ? 1 : 0;
    }
    EXPECT_EQ(taken, 99);
    EXPECT_EQ(admission.implausible(), 1u);
    copy.sequence = 98;
    copy.session_time_ns = 98 * kMs;
    EXPECT_TRUE(admission.accept(copy, 101 * kMs, 101 * kMs)) << "an overtaken copy fills a gap";
  }
}

}  // namespace
}  // namespace tactus::session
