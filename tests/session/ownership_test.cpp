#include "session/ownership.hpp"

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <queue>
#include <random>
#include <set>
#include <string>
#include <variant>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

/// Difference between incarnations of the host. The fencing numbers of a host begin after its incarnation, so the
/// difference must exceed the number of fencing numbers of one incarnation.
constexpr std::uint64_t kHostIncarnation = 1'000'000;
constexpr std::size_t kHrtcs = 4;
constexpr std::size_t kHostIndex = kHrtcs, kViewer = kHrtcs + 1;  // indices of programs after those of the HRTCs

Origin origin_of(std::uint64_t participant, std::uint64_t incarnation) {
  Origin origin;
  origin.session = kSession;
  origin.participant = participant;
  origin.incarnation = incarnation;
  return origin;
}

struct LinkSettings {
  double loss = 0, duplication = 0;  // probabilities
  std::int64_t delay_ms = 5, jitter_ms = 0;
};

/// Simulates a host, HRTCs and a viewer over a network that loses, duplicates and reorders samples. Owners and leaders
/// publish poses.
class OwnershipSimulation {
 public:
  explicit OwnershipSimulation(unsigned seed, const LinkSettings& link = {}) : link_{link}, random_{seed} {
    start_host();
    for (std::size_t i = 0; i < kHrtcs; ++i) start_hrtc(i);
    pose_admissions_.resize(kHrtcs + 2);  // HRTCs, host, viewer
  }

  void start_host() {
    host_ = std::make_unique<OwnershipArbiter>(origin_of(kHost, ++host_incarnation_ * kHostIncarnation), kObject,
                                               settings_, now_);
  }
  void start_hrtc(std::size_t i) {
    hrtcs_[i].incarnation = ++incarnations_;
    hrtcs_[i].claimant = std::make_unique<Claimant>(origin_of(i + 1, incarnations_), kObject, settings_);
    hrtcs_[i].sequence = 0;
    hrtcs_[i].role_at_suspension = Claimant::Role::kWatching;
  }

  Claimant& claimant(std::size_t i) { return *hrtcs_[i].claimant; }
  Claimant::Role role(std::size_t i) { return hrtcs_[i].claimant->role(now_); }
  OwnershipArbiter& host() { return *host_; }
  /// Disconnects an HRTC or the host until the given time.
  void disconnect(std::size_t program, std::int64_t until) { disconnected_until_[program] = until; }
  /// Loses what one program sends to another one until the given time. The other direction works.
  void cut(std::size_t from, std::size_t to, std::int64_t until) { cut_until_[{from, to}] = until; }
  /// Suspends an HRTC until the given time. If it was the owner, it publishes one pose when it resumes, before it reads
  /// the samples that were postponed.
  void suspend(std::size_t i, std::int64_t until) {
    hrtcs_[i].suspended_until = until;
    hrtcs_[i].role_at_suspension = role(i);
    hrtcs_[i].fencing_at_suspension = claimant(i).fencing();
  }
  void set_link(const LinkSettings& link) { link_ = link; }

  void run(std::int64_t ms) {
    for (const std::int64_t end = now_ + ms * kMs; now_ < end;) step();
  }

  /// Checks that no fencing number has poses of two owners, and that no two programs are owners at the same time.
  void check_invariants() const {
    for (const auto& [fencing, publishers] : publishers_)
      ASSERT_LE(publishers.size(), 1u) << "poses of two owners were accepted under fencing number " << fencing;
    // A restarted host may simulate the object during the lease of an owner, under another fencing number.
    if (host_incarnation_ > 1) return;
    int owners = host_->host_simulates() ? 1 : 0;
    for (const Hrtc& hrtc : hrtcs_) {
      const Claimant::Role role = hrtc.claimant->role(now_);
      if (role == Claimant::Role::kOwner && hrtc.suspended_until <= now_) ++owners;
    }
    ASSERT_LE(owners, 1) << "at " << now_ / kMs << " ms";
  }

  /// Number of poses refused because their fencing number was too small.
  [[nodiscard]] std::uint64_t refused() const { return refused_; }
  [[nodiscard]] std::int64_t now() const { return now_; }
  /// Time at which the viewer last accepted a pose.
  [[nodiscard]] std::int64_t shown_ns() const { return shown_ns_; }
  /// Participant that published the pose that the viewer accepted last.
  [[nodiscard]] std::uint64_t shown_publisher() const { return shown_publisher_; }

 private:
  using Message = std::variant<ObjectClaim, ObjectGrant, ObjectPose>;
  struct Packet {
    std::int64_t arrival_ns;
    std::uint64_t order;
    std::size_t to;
    Message message;
    bool operator>(const Packet& other) const {
      return arrival_ns != other.arrival_ns ? arrival_ns > other.arrival_ns : order > other.order;
    }
  };
  struct Hrtc {
    std::unique_ptr<Claimant> claimant;
    std::uint64_t incarnation = 0;
    std::uint32_t sequence = 0;
    std::int64_t suspended_until = 0;
    Claimant::Role role_at_suspension = Claimant::Role::kWatching;
    std::uint64_t fencing_at_suspension = 0;
  };

  double uniform() { return std::uniform_real_distribution<double>{0, 1}(random_); }
  [[nodiscard]] bool is_disconnected(std::size_t program) const {
    const auto until = disconnected_until_.find(program);
    return until != disconnected_until_.end() && until->second > now_;
  }
  [[nodiscard]] bool is_cut(std::size_t from, std::size_t to) const {
    const auto until = cut_until_.find({from, to});
    return until != cut_until_.end() && until->second > now_;
  }

  void send(std::size_t from, std::size_t to, const Message& message) {
    if (is_disconnected(from) || is_disconnected(to) || is_cut(from, to) || uniform() < link_.loss) return;
    for (int copies = uniform() < link_.duplication ? 2 : 1; copies > 0; --copies) {
      const auto jitter_ns = static_cast<std::int64_t>(uniform() * static_cast<double>(link_.jitter_ms * kMs));
      in_flight_.push({now_ + link_.delay_ms * kMs + jitter_ns, ++order_, to, message});
    }
  }
  void publish_pose(std::size_t from, std::uint64_t participant, std::uint64_t incarnation, std::uint64_t fencing,
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
      host_->on_claim(*claim, now_);
    } else if (const auto* grant = std::get_if<ObjectGrant>(&packet.message)) {
      hrtcs_[packet.to].claimant->on_grant(*grant, now_);
    } else if (const auto* pose = std::get_if<ObjectPose>(&packet.message)) {
      if (!pose_admissions_[packet.to].accept(*pose, now_)) {
        if (pose->fencing < pose_admissions_[packet.to].fencing()) ++refused_;
        return;
      }
      publishers_[pose->fencing].insert({pose->origin.participant, pose->origin.incarnation});
      if (packet.to == kHostIndex) host_->on_pose(pose->fencing, now_);
      if (packet.to < kHrtcs) hrtcs_[packet.to].claimant->on_pose(pose->fencing, now_);
      if (packet.to == kViewer) {
        shown_ns_ = now_;
        shown_publisher_ = pose->origin.participant;
      }
    }
  }

  void step() {
    now_ += kMs;
    std::vector<Packet> postponed;
    while (!in_flight_.empty() && in_flight_.top().arrival_ns <= now_) {
      const Packet packet = in_flight_.top();
      in_flight_.pop();
      if (packet.to < kHrtcs && hrtcs_[packet.to].suspended_until > now_) {
        postponed.push_back(packet);
        postponed.back().arrival_ns = hrtcs_[packet.to].suspended_until + kMs;
        continue;
      }
      receive(packet);
    }
    for (const Packet& packet : postponed) in_flight_.push(packet);

    for (std::size_t i = 0; i < kHrtcs; ++i) {
      Hrtc& hrtc = hrtcs_[i];
      if (hrtc.suspended_until > now_) continue;
      if (hrtc.suspended_until == now_ && hrtc.role_at_suspension == Claimant::Role::kOwner) {
        publish_pose(i, i + 1, hrtc.incarnation, hrtc.fencing_at_suspension, hrtc.sequence);
      }
      if (const auto claim = hrtc.claimant->tick(now_)) send(i, kHostIndex, *claim);
      const Claimant::Role role = hrtc.claimant->role(now_);
      if (role == Claimant::Role::kOwner || role == Claimant::Role::kLeader)
        publish_pose(i, i + 1, hrtc.incarnation, hrtc.claimant->fencing(), hrtc.sequence);
    }
    if (const auto grant = host_->tick(now_)) {
      for (std::size_t i = 0; i < kHrtcs; ++i) send(kHostIndex, i, *grant);
    }
    if (host_->host_simulates())
      publish_pose(kHostIndex, kHost, host_incarnation_ * kHostIncarnation, host_->fencing(), host_sequence_);
  }

  OwnershipSettings settings_;
  LinkSettings link_;
  std::mt19937 random_;
  std::int64_t now_ = 0;
  std::unique_ptr<OwnershipArbiter> host_;
  std::uint64_t host_incarnation_ = 0, incarnations_ = 0, order_ = 0, refused_ = 0;
  std::uint32_t host_sequence_ = 0;
  std::array<Hrtc, kHrtcs> hrtcs_;
  std::vector<PoseAdmission> pose_admissions_;
  std::priority_queue<Packet, std::vector<Packet>, std::greater<>> in_flight_;
  std::map<std::size_t, std::int64_t> disconnected_until_;
  std::map<std::pair<std::size_t, std::size_t>, std::int64_t> cut_until_;  // by sender and receiver
  std::map<std::uint64_t, std::set<std::pair<std::uint64_t, std::uint64_t>>>
      publishers_;  // by fencing number: participant, incarnation
  std::int64_t shown_ns_ = 0;
  std::uint64_t shown_publisher_ = 0;
};

TEST(Ownership, TheHostSimulatesAnObjectBeforeAndAfterATouch) {
  OwnershipSimulation session{1};
  session.run(300);
  EXPECT_EQ(session.shown_publisher(), kHost);
  session.claimant(0).set_touching(true);
  EXPECT_EQ(session.role(0), Claimant::Role::kRequesting);
  session.run(30);
  EXPECT_EQ(session.role(0), Claimant::Role::kOwner);
  EXPECT_EQ(session.shown_publisher(), 1u);
  EXPECT_FALSE(session.host().host_simulates());
  session.claimant(0).set_touching(false);
  EXPECT_EQ(session.role(0), Claimant::Role::kWatching);
  session.run(30);
  EXPECT_EQ(session.shown_publisher(), kHost);
}

TEST(Ownership, OfTwoTouchersEachSimulatesACopyAndTheFirstLeads) {
  OwnershipSimulation session{1};
  session.run(300);
  session.claimant(2).set_one_way(40 * kMs);
  session.claimant(2).set_touching(true);
  session.run(30);
  const std::uint64_t fencing_alone = session.claimant(2).fencing();
  session.claimant(1).set_touching(true);
  session.run(30);
  EXPECT_EQ(session.role(2), Claimant::Role::kLeader);
  EXPECT_EQ(session.role(1), Claimant::Role::kCopy);
  EXPECT_GT(session.claimant(1).fencing(), fencing_alone);
  EXPECT_EQ(session.claimant(1).grant().channel_delay_ns, 40 * kMs);
  EXPECT_NE(session.claimant(1).copy_index(), session.claimant(2).copy_index());
  EXPECT_EQ(session.shown_publisher(), 3u);
  session.claimant(2).set_touching(false);
  session.run(30);
  EXPECT_EQ(session.role(1), Claimant::Role::kOwner);
  EXPECT_EQ(session.shown_publisher(), 2u);
}

TEST(Ownership, ASuspendedOwnerLosesTheObjectAfterItsLeaseAndItsLatePoseIsRefused) {
  OwnershipSimulation session{1};
  session.run(300);
  session.claimant(0).set_touching(true);
  session.run(30);
  ASSERT_EQ(session.role(0), Claimant::Role::kOwner);
  session.suspend(0, session.now() + 600 * kMs);
  session.run(300);
  EXPECT_TRUE(session.host().host_simulates());
  EXPECT_EQ(session.shown_publisher(), kHost);
  const std::uint64_t refused_before = session.refused();
  session.run(310);  // the owner resumes and sends one more pose
  EXPECT_GT(session.refused(), refused_before);
  session.run(50);
  EXPECT_EQ(session.role(0), Claimant::Role::kOwner) << "a new grant, because its user still touches the object";
  session.check_invariants();
}

TEST(Ownership, TheLeaseGrowsWithTheRoundTrip) {
  OwnershipSimulation session{1, {0, 0, 300, 0}};
  session.run(700);
  for (const std::size_t i : {0u, 1u}) session.claimant(i).set_one_way(300 * kMs);
  session.claimant(0).set_touching(true);
  session.run(610);
  EXPECT_EQ(session.role(0), Claimant::Role::kOwner);
  session.run(1000);
  EXPECT_EQ(session.role(0), Claimant::Role::kOwner) << "the user still touches the object";
  session.disconnect(0, session.now() + 3000 * kMs);
  session.run(850);
  EXPECT_EQ(session.role(0), Claimant::Role::kRequesting);
  session.run(400);
  EXPECT_TRUE(session.host().host_simulates());
  session.check_invariants();
}

TEST(Ownership, ADisconnectedOwnerStopsBeforeTheHostSimulatesTheObject) {
  OwnershipSimulation session{1};
  session.run(300);
  session.claimant(0).set_touching(true);
  session.run(30);
  session.disconnect(0, session.now() + 1000 * kMs);
  std::int64_t owner_stopped = 0, host_started = 0;
  for (int ms = 0; ms < 500; ++ms) {
    session.run(1);
    if (owner_stopped == 0 && session.role(0) != Claimant::Role::kOwner) owner_stopped = session.now();
    if (host_started == 0 && session.host().host_simulates()) host_started = session.now();
  }
  ASSERT_GT(owner_stopped, 0);
  ASSERT_GT(host_started, 0);
  EXPECT_LE(owner_stopped, host_started);
}

TEST(Ownership, ACutInOneDirectionEndsTheLeaseBeforeAnotherProgramSimulatesTheObject) {
  constexpr std::int64_t kDelayMs = 5;
  const std::int64_t max_lease_ms = OwnershipSettings{}.lease_ns / kMs + 2 * kDelayMs;
  for (const bool claims_are_lost : {true, false}) {
    SCOPED_TRACE(claims_are_lost ? "claims are lost" : "grants are lost");
    OwnershipSimulation session{1, {0, 0, kDelayMs, 0}};
    const auto run = [&](std::int64_t ms) {
      for (; ms > 0; --ms) {
        session.run(1);
        session.check_invariants();
        if (HasFatalFailure()) return;
      }
    };
    run(300);
    session.claimant(0).set_touching(true);
    run(30);
    ASSERT_EQ(session.role(0), Claimant::Role::kOwner);
    const std::int64_t until = session.now() + 3000 * kMs;
    if (claims_are_lost)
      session.cut(0, kHostIndex, until);
    else
      session.cut(kHostIndex, 0, until);
    run(max_lease_ms);
    EXPECT_EQ(session.role(0), Claimant::Role::kRequesting) << "its lease has ended";
    EXPECT_EQ(session.host().host_simulates(), claims_are_lost) << "the host receives the claims, so nobody simulates";
    // Another HRTC touches the object: as the owner, or beside a toucher that does not know of its grant.
    session.claimant(1).set_touching(true);
    run(500);
    EXPECT_EQ(session.role(0), Claimant::Role::kRequesting);
    EXPECT_EQ(session.role(1), claims_are_lost ? Claimant::Role::kOwner : Claimant::Role::kCopy);
    run((until - session.now()) / kMs + 100);
    const std::set<Claimant::Role> roles{session.role(0), session.role(1)};
    EXPECT_EQ(roles, (std::set<Claimant::Role>{Claimant::Role::kLeader, Claimant::Role::kCopy}));
    if (HasFailure()) return;
  }
}

TEST(Ownership, ARestartedHostGrantsALargerFencingNumber) {
  OwnershipSimulation session{1};
  session.run(300);
  session.claimant(0).set_touching(true);
  session.run(30);
  session.claimant(1).set_touching(true);
  session.run(30);
  const std::uint64_t fencing_before = session.claimant(0).fencing();
  session.start_host();
  session.run(400);
  EXPECT_GT(session.claimant(0).fencing(), fencing_before);
  const std::set<Claimant::Role> roles{session.role(0), session.role(1)};
  EXPECT_EQ(roles, (std::set<Claimant::Role>{Claimant::Role::kLeader, Claimant::Role::kCopy}));
  session.check_invariants();
}

using Touches = std::array<bool, kHrtcs>;

/// Disconnects, suspends or restarts a random program, cuts a direction of a link, or begins or ends a touch.
void apply_random_event(std::mt19937& random, bool host_restarts, OwnershipSimulation& session, Touches& touches) {
  const auto below = [&](int bound) { return static_cast<int>(random() % static_cast<unsigned>(bound)); };
  const auto hrtc = static_cast<std::size_t>(below(kHrtcs));
  switch (below(11)) {
    case 0:
      session.disconnect(static_cast<std::size_t>(below(kHrtcs + 1)), session.now() + below(600) * kMs);
      break;
    case 1:
      session.suspend(hrtc, session.now() + below(500) * kMs);
      break;
    case 2:
      session.start_hrtc(hrtc);
      touches[hrtc] = false;
      session.claimant(hrtc).set_one_way(below(400) * kMs);  // even a wrong transit must not cause two owners
      break;
    case 3:
      if (host_restarts) session.start_host();
      break;
    case 4: {
      const bool claims_are_lost = below(2) == 0;
      session.cut(claims_are_lost ? hrtc : kHostIndex, claims_are_lost ? kHostIndex : hrtc,
                  session.now() + below(600) * kMs);
      break;
    }
    default:
      session.claimant(hrtc).set_touching(touches[hrtc] = !touches[hrtc]);
  }
}

void expect_one_owner(OwnershipSimulation& session, const Touches& touches) {
  int touching = 0, simulating = 0, leading = 0;
  for (std::size_t i = 0; i < kHrtcs; ++i) {
    touching += touches[i] ? 1 : 0;
    const Claimant::Role role = session.role(i);
    if (role == Claimant::Role::kCopy || role == Claimant::Role::kLeader || role == Claimant::Role::kOwner)
      ++simulating;
    if (role == Claimant::Role::kLeader || role == Claimant::Role::kOwner) ++leading;
  }
  EXPECT_EQ(simulating, touching);
  EXPECT_EQ(leading, touching > 0 ? 1 : 0);
  EXPECT_EQ(session.host().host_simulates(), touching == 0);
  EXPECT_GT(session.shown_ns(), session.now() - 50 * kMs) << "no program simulates the object";
}

TEST(Ownership, NoFencingNumberHasTwoOwnersUnderFaultsAndOneOwnerRemainsAfterThem) {
  std::uint64_t refused = 0;
  for (unsigned seed = 1; seed <= 150; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random{seed};
    const auto below = [&](int bound) { return static_cast<int>(random() % static_cast<unsigned>(bound)); };
    LinkSettings link;
    link.loss = 0.01 * below(40);
    link.duplication = 0.01 * below(30);
    link.delay_ms = below(100);
    link.jitter_ms = below(80);
    OwnershipSimulation session{seed, link};
    Touches touches{};
    for (int event = 0; event < 60; ++event) {
      apply_random_event(random, seed % 3 == 0, session, touches);
      for (int ms = below(150); ms > 0; --ms) {
        session.run(1);
        session.check_invariants();
        if (HasFatalFailure()) return;
      }
    }
    refused += session.refused();

    // All faults end; the touches remain.
    session.set_link({});
    for (std::size_t program = 0; program <= kHrtcs; ++program) session.disconnect(program, 0);
    session.run(2500);
    session.check_invariants();
    expect_one_owner(session, touches);
    if (HasFailure()) return;
  }
  EXPECT_GT(refused, 100u);
}

TEST(PoseAdmission, RefusesASmallerFencingNumberAnOvertakenPoseAndASecondPublisher) {
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

TEST(OwnershipArbiter, GrantsToTouchersDespiteOneImplausibleClaim) {
  for (const bool sequence_is_wrong : {true, false}) {
    OwnershipArbiter arbiter{origin_of(kHost, kHostIncarnation), kObject, {}, 0};
    std::int64_t now = 300 * kMs;
    std::uint32_t sequence = 0;
    for (int i = 0; i < 10; ++i) arbiter.on_claim(claim_of(1, 3, ++sequence, true), now += 20 * kMs);
    const ObjectClaim wrong =
        sequence_is_wrong ? claim_of(1, 3, 0xffffffff, true) : claim_of(1, UINT64_MAX, ++sequence, true);
    arbiter.on_claim(wrong, now);
    for (int i = 0; i < 100; ++i) {
      arbiter.on_claim(claim_of(1, 3, ++sequence, true), now += 20 * kMs);
      (void)arbiter.tick(now);
    }
    ASSERT_FALSE(arbiter.host_simulates()) << "an HRTC touches the object";
    arbiter.on_claim(claim_of(1, 3, ++sequence, false), now += 20 * kMs);
    const std::optional<ObjectGrant> grant = arbiter.tick(now);
    ASSERT_TRUE(grant);
    EXPECT_TRUE(grant->touchers.empty()) << "the HRTC has released the object";
  }
}

TEST(OwnershipArbiter, GrantsToEightTouchersAndToTheNinthWhenOneOfThemReleasesTheObject) {
  constexpr std::uint64_t kMax = 8, kNinth = 9;
  OwnershipArbiter arbiter{origin_of(kHost, kHostIncarnation), kObject, {}, 0};
  Claimant ninth{origin_of(kNinth, 1), kObject, {}};
  std::int64_t now = 300 * kMs;
  std::uint32_t sequence = 0;
  std::optional<ObjectGrant> grant;
  const auto exchange = [&](std::uint64_t touchers) {
    now += 20 * kMs;
    ++sequence;
    for (std::uint64_t i = 1; i <= kMax; ++i) arbiter.on_claim(claim_of(i, 1, sequence, i <= touchers), now);
    if (const std::optional<ObjectClaim> claim = ninth.tick(now)) arbiter.on_claim(*claim, now);
    grant = arbiter.tick(now);
    ASSERT_TRUE(grant);
    ninth.on_grant(*grant, now);
  };
  exchange(kMax);
  ASSERT_EQ(grant->touchers.size(), kMax);
  const std::uint64_t fencing = grant->fencing;

  EXPECT_EQ(arbiter.refused(), 0u);
  ninth.set_touching(true);
  for (int i = 0; i < 50; ++i) exchange(kMax);
  EXPECT_EQ(arbiter.refused(), 50u);
  EXPECT_EQ(grant->touchers.size(), kMax);
  EXPECT_EQ(grant->fencing, fencing) << "the ninth HRTC must not disturb the others";
  EXPECT_EQ(ninth.copy_index(), kMaxTouchers);
  EXPECT_EQ(ninth.role(now), Claimant::Role::kRequesting);

  exchange(kMax - 1);
  EXPECT_EQ(grant->touchers.size(), kMax);
  EXPECT_EQ(grant->touchers.back().participant, kNinth);
  EXPECT_EQ(ninth.role(now), Claimant::Role::kCopy);
  EXPECT_EQ(arbiter.refused(), 50u);
}

TEST(OwnershipArbiter, IgnoresAnImplausibleFencingNumber) {
  OwnershipArbiter arbiter{origin_of(kHost, kHostIncarnation), kObject, {}, 0};
  std::int64_t now = 300 * kMs;
  (void)arbiter.tick(now);
  const std::uint64_t fencing_before = arbiter.fencing();
  ObjectClaim wrong = claim_of(1, 3, 1, false);
  wrong.fencing = UINT64_MAX;
  arbiter.on_claim(wrong, now);
  EXPECT_EQ(arbiter.fencing(), fencing_before);
}

/// Fencing numbers that no host reaches.
constexpr std::uint64_t kWrongFencings[] = {UINT64_MAX, UINT64_MAX - 1, 2 * kMaxFollowedFencing + 1,
                                            2 * kMaxFollowedFencing, kMaxFollowedFencing + 1};
/// An incarnation of a host that starts in the year 2026.
constexpr std::uint64_t kIncarnationOf2026 = 1'795'000'000'000'000'000;

ObjectPose pose_of(std::uint64_t participant, std::uint32_t sequence, std::uint64_t fencing) {
  ObjectPose pose;
  pose.origin = origin_of(participant, 1);
  pose.object_id = kObject;
  pose.sequence = sequence;
  pose.fencing = fencing;
  return pose;
}

/// A host with an object, and an HRTC and a viewer that receive its samples. Another HRTC sends wrong poses.
class WrongFencing : public ::testing::Test {
 protected:
  void run(std::int64_t ms) {
    for (; ms > 0; --ms) {
      now_ += kMs;
      if (const auto claim = claimant_.tick(now_)) arbiter_.on_claim(*claim, now_);
      if (const auto grant = arbiter_.tick(now_)) claimant_.on_grant(*grant, now_);
      const bool owns = claimant_.role(now_) == Claimant::Role::kOwner;
      if (owns) publish(pose_of(kToucher, ++sequence_, claimant_.fencing()));
      if (arbiter_.host_simulates()) publish(pose_of(kHost, ++sequence_, arbiter_.fencing()));
    }
  }
  void publish(const ObjectPose& pose) {
    if (pose.origin.participant != kHost && host_admission_.accept(pose, now_))
      (void)arbiter_.on_pose(pose.fencing, now_);
    if (pose.origin.participant != kToucher && hrtc_admission_.accept(pose, now_))
      claimant_.on_pose(pose.fencing, now_);
    if (viewer_admission_.accept(pose, now_)) shown_ns_ = now_;
  }
  void send_wrong_poses(std::uint64_t fencing) {
    for (std::uint32_t i = 1; i <= 3; ++i) {
      publish(pose_of(kWrongHrtc, i, fencing));
      run(10);
    }
  }
  /// Checks that an HRTC gets the object and gives it back, and that the viewer shows it meanwhile.
  void expect_hand_over() {
    for (const bool touching : {true, false}) {
      claimant_.set_touching(touching);
      run(700);
      EXPECT_EQ(claimant_.role(now_), touching ? Claimant::Role::kOwner : Claimant::Role::kWatching);
      EXPECT_EQ(arbiter_.host_simulates(), !touching);
      EXPECT_EQ(shown_ns_, now_);
    }
  }

  static constexpr std::uint64_t kToucher = 1, kWrongHrtc = 2;
  std::int64_t now_ = 0, shown_ns_ = 0;
  std::uint32_t sequence_ = 0;
  OwnershipArbiter arbiter_{origin_of(kHost, kIncarnationOf2026), kObject, {}, 0};
  Claimant claimant_{origin_of(kToucher, 1), kObject, {}};
  PoseAdmission host_admission_, hrtc_admission_, viewer_admission_;
};

TEST_F(WrongFencing, ThreePosesWithANumberThatNoHostReachesDoNotBlockLaterOnes) {
  run(400);
  for (const std::uint64_t wrong : kWrongFencings) {
    SCOPED_TRACE(wrong);
    send_wrong_poses(wrong);
    expect_hand_over();
    EXPECT_LT(arbiter_.fencing(), kIncarnationOf2026 + 100) << "the host does not follow";
  }
}

TEST_F(WrongFencing, ProgramsThatStartDuringWrongPosesAcceptLaterOnes) {
  for (const std::uint64_t wrong : kWrongFencings) {
    SCOPED_TRACE(wrong);
    run(400);
    claimant_ = Claimant{origin_of(kToucher, 1), kObject, {}};
    hrtc_admission_ = viewer_admission_ = {};
    send_wrong_poses(wrong);
    expect_hand_over();
  }
}

TEST_F(WrongFencing, TheLargestNumberThatAHostFollowsLeavesRoomForLaterOnes) {
  run(400);
  send_wrong_poses(kMaxFollowedFencing);
  expect_hand_over();
  EXPECT_GT(arbiter_.fencing(), kMaxFollowedFencing);
  viewer_admission_ = {};  // of a viewer that starts now
  send_wrong_poses(UINT64_MAX);
  expect_hand_over();
}

TEST(OwnershipArbiter, AHostWithAWrongIncarnationGrantsNoNumberPastTheEndOfTheRange) {
  OwnershipArbiter arbiter{origin_of(kHost, UINT64_MAX), kObject, {}, 0};
  const std::optional<ObjectGrant> grant = arbiter.tick(300 * kMs);
  ASSERT_TRUE(grant);
  EXPECT_EQ(grant->fencing, 2 * kMaxFollowedFencing + 1);
}

TEST(Claimant, AcceptsGrantsAfterOneImplausibleGrant) {
  for (const bool sequence_is_wrong : {true, false}) {
    Claimant claimant{origin_of(1, 1), kObject, {}};
    claimant.set_touching(true);
    std::int64_t now = 0;
    std::uint32_t sequence = 0;
    for (int i = 0; i < 100; ++i) {
      now += 20 * kMs;
      const std::optional<ObjectClaim> claim = claimant.tick(now);
      ASSERT_TRUE(claim);
      ObjectGrant grant = grant_of(++sequence, 7);
      if (i == 50) (sequence_is_wrong ? grant.sequence = 0xffffffff : grant.fencing = UINT64_MAX);
      grant.touchers = {{1, 1, claim->sequence}};
      claimant.on_grant(grant, now);
    }
    EXPECT_EQ(claimant.role(now), Claimant::Role::kOwner);
  }
}

TEST(PoseAdmission, AcceptsPosesAfterOneImplausiblePose) {
  for (const bool sequence_is_wrong : {true, false}) {
    PoseAdmission admission;
    ObjectPose pose;
    pose.origin = origin_of(1, 1);
    pose.fencing = 3;
    int accepted = 0;
    for (std::uint32_t i = 1; i <= 100; ++i) {
      ObjectPose sent = pose;
      sent.sequence = i;
      if (i == 50) (sequence_is_wrong ? sent.sequence = 0xffffffff : sent.fencing = UINT64_MAX);
      accepted += admission.accept(sent, i * 4 * kMs) ? 1 : 0;
    }
    EXPECT_EQ(accepted, 99);
  }
}

ObjectGrant group_of(std::uint64_t fencing) {
  ObjectGrant grant;
  grant.fencing = fencing;
  grant.touchers = {{1, 1, 1}, {2, 1, 1}};
  return grant;
}

TEST(CopyAdmission, AcceptsOnlyTheCopiesOfTheGrant) {
  CopyAdmission admission;
  std::uint32_t sequence = 0;
  const auto accepts = [&](std::uint64_t participant, std::uint64_t incarnation, std::uint32_t index,
                           std::uint64_t fencing) {
    ObjectCopy copy;
    copy.origin = origin_of(participant, incarnation);
    copy.sequence = ++sequence;
    copy.copy_index = index;
    copy.fencing = fencing;
    copy.session_time_ns = sequence * kMs;
    return admission.accept(copy, sequence * kMs, sequence * kMs);
  };
  EXPECT_FALSE(accepts(2, 1, 1, 0)) << "there is no grant yet";
  admission.set_group(group_of(5));
  EXPECT_TRUE(accepts(2, 1, 1, 5));
  EXPECT_FALSE(accepts(3, 1, 1, 5)) << "another program";
  EXPECT_FALSE(accepts(2, 1, 0, 5)) << "the copy of another one";
  EXPECT_FALSE(accepts(2, 2, 1, 5)) << "another start of the program";
  EXPECT_FALSE(accepts(3, 1, 2, 5)) << "a copy that there is not";
  EXPECT_FALSE(accepts(2, 1, 0xffffffff, 5));
  EXPECT_FALSE(accepts(2, 1, 1, 4)) << "another group";
  admission.set_group({});
  EXPECT_FALSE(accepts(2, 1, 1, 5)) << "the group has ended";
}

TEST(CopyAdmission, AcceptsSamplesAfterOneImplausibleSample) {
  for (const bool sequence_is_wrong : {true, false}) {
    CopyAdmission admission;
    admission.set_group(group_of(5));
    ObjectCopy copy;
    copy.origin = origin_of(2, 1);
    copy.fencing = 5;
    copy.copy_index = 1;
    int accepted = 0;
    for (std::uint32_t i = 1; i <= 100; ++i) {
      copy.sequence = i;
      copy.session_time_ns = i * kMs;
      if (i == 50) (sequence_is_wrong ? copy.sequence = 0xffffffff : copy.session_time_ns = INT64_MAX);
      accepted += admission.accept(copy, i * kMs, i * kMs) ? 1 : 0;
    }
    EXPECT_EQ(accepted, 99);
    EXPECT_EQ(admission.implausible(), 1u);
    copy.sequence = 98;
    copy.session_time_ns = 98 * kMs;
    EXPECT_TRUE(admission.accept(copy, 101 * kMs, 101 * kMs)) << "an overtaken sample fills a gap";
  }
}

}  // namespace
}  // namespace tactus::session
