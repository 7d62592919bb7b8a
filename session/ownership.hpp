/// Ownership of a shared object: the host simulates it while nobody touches it, then the first toucher, then all.
///
///     no toucher         the host simulates
///     one toucher        it owns the object and publishes its poses
///     several touchers   each simulates a copy (haptics/coupling.hpp); the one that has held longest leads and
///                        publishes the object's poses
///
/// Touchers repeat a claim while they touch, and the host repeats a grant in answer. Both are states, so lost, repeated
/// or late samples need no special case. Each change of ownership gets a larger fencing number. Receivers accept a pose
/// only under the largest one received. So a former owner that was suspended cannot move the object any more.
///
///     toucher   claim 7 ----------->  host      lease until the claim's arrival + lease
///               <-- grant 12: claim 7 toucher   may simulate until it sent claim 7 + lease
///
/// The lease is extended by the round trip that claim 7 reports, so that grants arrive in time on long links.
///
/// A toucher's lease ends before the host takes the object back; this needs no synchronised clocks. A host that starts
/// waits for the shortest lease before it simulates, and learns the current fencing number from claims and poses.
///
/// A toucher feels the object before the grant: it simulates at once for itself (Holder::Role::kRequesting), and its
/// state becomes the object's with the grant.
/// Source: Gray, Cheriton 1989 (leases).
///
/// No clock, socket or thread; one thread at a time.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

struct OwnershipSettings {
  std::int64_t lease_ns = 250'000'000;  ///< in addition to the round trip that the claim reports
  std::int64_t period_ns = 20'000'000;  ///< of claims, and of grants while somebody holds the object
  std::int64_t idle_ns = 500'000'000;   ///< of grants while nobody holds it
};

/// The host's side, for one object.
class Arbiter {
 public:
  /// `fencing`: PoseGate::confirmed_fencing of the poses that this host has received.
  Arbiter(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings, std::int64_t now_ns,
          std::uint64_t fencing = 0);

  void on_claim(const ObjectClaim& claim, std::int64_t now_ns);
  /// A pose of the object from another program, and its fencing number.
  void on_pose(std::uint64_t fencing, std::int64_t now_ns);
  /// An HRTC has left the session: drops the numbering of its claims. A lease of it ends in time.
  void forget(std::uint64_t participant);
  /// The grant to publish now; none if nothing has changed and no repetition is due.
  [[nodiscard]] std::optional<ObjectGrant> tick(std::int64_t now_ns);

  /// Whether the host itself has to simulate, under `fencing()`.
  [[nodiscard]] bool owns(std::int64_t now_ns) const noexcept;
  [[nodiscard]] std::uint64_t fencing() const noexcept { return fencing_; }
  /// Claims and fencing numbers that were dropped because they are outside their windows (session/sequence_window.hpp).
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  struct Held {
    Toucher toucher;
    std::int64_t until_ns;
    std::int64_t one_way_ns;
  };
  /// Senders of claims: an old claim must not bring back a toucher that has let go.
  struct Claimant {
    std::uint64_t participant;
    std::int64_t seen_ns;
    SenderWindow claims;
  };
  void change(std::int64_t now_ns);
  [[nodiscard]] bool is_newer(const ObjectClaim& claim, std::int64_t now_ns);

  Origin self_;
  std::uint64_t object_id_;
  OwnershipSettings settings_;
  std::int64_t quiet_until_ns_;  // one lease after the start: a lease granted before may still be valid
  std::uint64_t fencing_ = 0;
  SequenceWindow fencings_;          // of claims, of others' poses and of this host
  std::vector<Held> held_;           // longest first
  std::vector<Claimant> claimants_;  // at most kMaxClaimants, all holders among them
  std::uint64_t implausible_ = 0;
  std::int64_t channel_delay_ns_ = 0;
  std::uint32_t sequence_ = 0;
  std::int64_t granted_ns_ = 0;
  bool changed_ = true;
};

/// An HRTC's side, for one object.
class Holder {
 public:
  enum class Role : std::uint8_t {
    kWatching,    ///< does not touch: shows the owner's poses
    kRequesting,  ///< touches without a grant: simulates for itself, publishes nothing
    kOwner,       ///< the only toucher: simulates and publishes
    kLeader,      ///< simulates one of several copies, publishes
    kCopy         ///< simulates one of several copies
  };

  Holder(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings);

  void touch(bool touching) noexcept;
  void set_one_way(std::int64_t one_way_ns) noexcept { one_way_ns_ = one_way_ns; }
  /// A pose of the object was accepted.
  void on_pose(std::uint64_t fencing, std::int64_t now_ns) noexcept { (void)admit_fencing(fencing, now_ns); }
  void on_grant(const ObjectGrant& grant, std::int64_t now_ns);
  /// The claim to publish now; none if none is due.
  [[nodiscard]] std::optional<ObjectClaim> tick(std::int64_t now_ns);

  [[nodiscard]] Role role(std::int64_t now_ns) const noexcept;
  /// For the poses that an owner or a leader publishes.
  [[nodiscard]] std::uint64_t fencing() const noexcept { return granted_.fencing; }
  /// The grant with all copies, this one included, from which to build the coupling. A new `fencing` is a new group.
  [[nodiscard]] const ObjectGrant& grant() const noexcept { return granted_; }
  /// Its own index among the copies.
  [[nodiscard]] std::size_t copy_index() const noexcept { return copy_index_; }
  /// Grants that were dropped because fencing number or sequence is outside its window.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  [[nodiscard]] bool admit_fencing(std::uint64_t fencing, std::int64_t now_ns) noexcept;
  Origin self_;
  std::uint64_t object_id_;
  OwnershipSettings settings_;
  bool touching_ = false;
  std::uint32_t sequence_ = 0;
  std::int64_t claimed_ns_ = 0;
  bool changed_ = false;
  struct Sent {
    std::uint32_t sequence;
    std::int64_t at_ns;
    bool touching;
    std::int64_t lease_ns;
  };
  std::array<Sent, 64> sent_{};               // claims, by sequence
  ObjectGrant granted_;                       // with the largest fencing number seen
  SequenceWindow fencings_{kFencingNumbers};  // of grants and poses
  SequenceWindow grants_{kClaimNumbers};      // under the fencing number of `granted_`
  std::uint64_t implausible_ = 0;
  std::size_t copy_index_ = kMaxTouchers;
  std::int64_t until_ns_ = 0;  // end of the lease, counted from the sending of its claim
  std::int64_t one_way_ns_ = 0;
  int release_claims_ = 0;  // claims to send after letting go
};

/// Decides which samples of an object's copies count, for an HRTC that simulates one of them.
class CopyGate {
 public:
  /// False: implausible (session/sequence_window.hpp). An overtaken sample counts, because it fills a gap. Realtime.
  [[nodiscard]] bool accept(const ObjectCopy& copy, std::int64_t now_ns, std::int64_t session_now_ns) noexcept;
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  struct Peer {
    std::uint64_t participant = 0;  // 0: none
    std::int64_t seen_ns = INT64_MIN;
    SenderWindow numbers{kCycleNumbers};
    TimeWindow times;
  };
  std::array<Peer, kMaxTouchers> peers_;
  std::uint64_t implausible_ = 0;
};

/// Decides which poses of an object count, for a program that shows it.
class PoseGate {
 public:
  /// False: from an older owner, older than the newest pose of the owner, or implausible (session/sequence_window.hpp).
  [[nodiscard]] bool accept(const ObjectPose& pose, std::int64_t now_ns) noexcept;
  [[nodiscard]] std::uint64_t fencing() const noexcept { return fencings_.newest(); }
  /// 0 after a single pose, because its number may have been wrong.
  [[nodiscard]] std::uint64_t confirmed_fencing() const noexcept {
    return fencings_.confirmed() ? fencings_.newest() : 0;
  }
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  SequenceWindow fencings_{kFencingNumbers};
  SequenceWindow poses_{kObjectPoseNumbers};  // of the owner, under the newest fencing number
  std::uint64_t participant_ = 0, incarnation_ = 0;
  std::uint64_t implausible_ = 0;
};

}  // namespace tactus::session
