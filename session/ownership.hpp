/// Who simulates a shared object: the host while nobody holds it, then the first who touches it, then all who do.
///
///     nobody            host simulates
///     one toucher       it owns: its poses are the object's
///     two and more      each simulates a copy (haptics/coupling.hpp); the one that has held longest leads: its poses
///     are
///                       the object's for everyone else
///
/// Touchers claim, again and again while they touch; the host answers with a grant, again and again too: both are
/// states, so what is lost, doubled or late needs no case of its own. Each change of those who simulate gets a larger
/// fencing number, and a pose counts only under the largest one seen: a former owner that does not know yet, or that
/// was asleep, cannot move the object any more.
///
///     toucher   claim 7 ---------->  host      lease until arrival + lease
///               <-- grant 12: you, claim 7     toucher may simulate until it sent claim 7 + lease
///
/// where the lease is longer by the way there and back that claim 7 tells of, or else no grant would come in time.
///
/// A toucher's lease ends before the host takes the object back, without synchronised clocks. A host that starts
/// waits for the shortest lease before it simulates itself and learns the fencing numbers in use from claims and poses.
///
/// A toucher does not wait for the grant to feel: it simulates at once for itself (Holder::Role::kAsking), and what it
/// has by then becomes the object.
///
/// No clock, socket or thread in it; one thread at a time.
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
  std::int64_t lease_ns = 250'000'000;  ///< beyond the way of claim and grant, as the claim tells it
  std::int64_t period_ns = 20'000'000;  ///< between claims, and between grants while somebody holds the object
  std::int64_t idle_ns = 500'000'000;   ///< between grants while nobody does
};

/// The host's side, for one object.
class Arbiter {
 public:
  /// `fencing`: PoseGate::confirmed_fencing of what this host has seen.
  Arbiter(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings, std::int64_t now_ns,
          std::uint64_t fencing = 0);

  void on_claim(const ObjectClaim& claim, std::int64_t now_ns);
  /// A pose of the object from somebody else, with which fencing number.
  void on_pose(std::uint64_t fencing, std::int64_t now_ns);
  /// A controller is gone from the session: its claims are no longer recorded. A lease of it ends in its time.
  void forget(std::uint64_t participant);
  /// The grant to publish now; none when nothing has changed and none is due.
  [[nodiscard]] std::optional<ObjectGrant> tick(std::int64_t now_ns);

  /// Whether the host itself is to simulate, under `fencing()`.
  [[nodiscard]] bool owns(std::int64_t now_ns) const noexcept;
  [[nodiscard]] std::uint64_t fencing() const noexcept { return fencing_; }
  /// Claims and fencing numbers dropped because they are outside their window (session/sequence_window.hpp).
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  struct Held {
    Toucher toucher;
    std::int64_t until_ns;
    std::int64_t one_way_ns;
  };
  /// Whose claims have come: an old claim does not bring back one who has let go.
  struct Claimant {
    std::uint64_t participant;
    std::int64_t seen_ns;
    SenderWindow claims;
  };
  void change(std::int64_t now_ns);
  [[nodiscard]] bool is_news(const ObjectClaim& claim, std::int64_t now_ns);

  Origin self_;
  std::uint64_t object_id_;
  OwnershipSettings settings_;
  std::int64_t quiet_until_ns_;  // a lease after the start: somebody may hold one from before
  std::uint64_t fencing_ = 0;
  SequenceWindow fencings_;          // in use; this host's own among them
  std::vector<Held> held_;           // longest first
  std::vector<Claimant> claimants_;  // at most kMaxClaimants, among them all who hold
  std::uint64_t implausible_ = 0;
  std::int64_t line_ns_ = 0;
  std::uint32_t sequence_ = 0;
  std::int64_t granted_ns_ = 0;
  bool changed_ = true;
};

/// A controller's side, for one object.
class Holder {
 public:
  enum class Role : std::uint8_t {
    kWatching,  ///< shows the poses of whoever simulates
    kAsking,    ///< touches, not granted yet: simulates for itself, publishes nothing
    kOwner,     ///< simulates alone, publishes
    kLeader,    ///< one of several copies, publishes
    kCopy       ///< one of several copies
  };

  Holder(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings);

  void touch(bool touching) noexcept;
  void set_one_way(std::int64_t one_way_ns) noexcept { one_way_ns_ = one_way_ns; }
  /// A pose of the object was accepted.
  void on_pose(std::uint64_t fencing, std::int64_t now_ns) noexcept { (void)see(fencing, now_ns); }
  void on_grant(const ObjectGrant& grant, std::int64_t now_ns);
  /// The claim to send now; none when none is due.
  [[nodiscard]] std::optional<ObjectClaim> tick(std::int64_t now_ns);

  [[nodiscard]] Role role(std::int64_t now_ns) const noexcept;
  /// To publish poses with, as owner or leader.
  [[nodiscard]] std::uint64_t fencing() const noexcept { return granted_.fencing; }
  /// Of the copies, this one included; what the coupling is to be built from. A new group whenever `fencing` changes.
  [[nodiscard]] const ObjectGrant& grant() const noexcept { return granted_; }
  /// Its own number among the copies.
  [[nodiscard]] std::size_t place() const noexcept { return place_; }
  /// Grants dropped because their fencing number or sequence is outside its window.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  [[nodiscard]] bool see(std::uint64_t fencing, std::int64_t now_ns) noexcept;
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
  std::array<Sent, 64> sent_{};  // claims, by sequence
  ObjectGrant granted_;          // with the largest fencing number seen
  SequenceWindow fencings_{kFencingNumbers};  // of grants and poses
  SequenceWindow grants_{kClaimNumbers};      // under the fencing number of `granted_`
  std::uint64_t implausible_ = 0;
  std::size_t place_ = kMaxTouchers;
  std::int64_t until_ns_ = 0;  // end of the lease, by when its claim was sent
  std::int64_t one_way_ns_ = 0;
  int farewells_ = 0;  // claims to send after letting go
};

/// Which samples of an object's copies count, for whoever simulates one of them.
class CopyGate {
 public:
  /// False: implausible (session/sequence_window.hpp). One that was overtaken counts: it fills a gap. Realtime.
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

/// Which poses of an object count, for whoever shows it.
class PoseGate {
 public:
  /// False: an older owner's, an older pose of the same, or one that is implausible (session/sequence_window.hpp).
  [[nodiscard]] bool accept(const ObjectPose& pose, std::int64_t now_ns) noexcept;
  [[nodiscard]] std::uint64_t fencing() const noexcept { return fencings_.newest(); }
  /// 0 while a single pose is known: it may have been wrong.
  [[nodiscard]] std::uint64_t confirmed_fencing() const noexcept {
    return fencings_.confirmed() ? fencings_.newest() : 0;
  }
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  SequenceWindow fencings_{kFencingNumbers};
  SequenceWindow poses_{kObjectPoseNumbers};  // of the author, under the newest fencing number
  std::uint64_t participant_ = 0, incarnation_ = 0;
  std::uint64_t implausible_ = 0;
};

}  // namespace tactus::session
