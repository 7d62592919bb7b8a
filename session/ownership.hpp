/// Ownership of a shared object: the claims of HRTCs and the grants of its host decide which programs simulate it.
///
///     no toucher         the host simulates
///     one toucher        it owns the object and publishes its poses
///     several touchers   each simulates a copy (haptics/coupling.hpp); the one that has touched for longest leads and
///                        publishes the object's poses
///
/// A toucher is an HRTC whose user touches the object. Touchers repeat a claim while they touch, and the host repeats a
/// grant. Each claim and each grant is complete, so lost, repeated or overtaken samples need no special case. Each
/// change of the touchers gets a larger fencing number. Receivers accept a pose only under the largest fencing number
/// that they have received. So a former owner that was suspended cannot move the object any more.
///
///     toucher   claim 7 ----------->  host      its lease ends one lease time after the arrival of claim 7
///               <-- grant 12: claim 7 toucher   its lease ends one lease time after the sending of claim 7
///
/// So a toucher's lease ends before the host takes the object back, and this needs no synchronised clocks. The lease
/// time is a constant plus twice the transit that the claim states, so that grants arrive in time on long links.
///
/// A host that starts waits for the shortest lease time before it grants: another host may have granted a lease. It
/// learns the current fencing number from claims and poses. If several hosts serve the object, all but one stand by.
/// They process claims and poses too, so each of them knows the touchers and can take the object over.
///
/// A toucher feels the object before the first grant arrives. Until then it simulates the object for itself
/// (Claimant::Role::kRequesting). With the grant, its state becomes the state of the object.
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
  std::int64_t lease_ns = 250'000'000;  ///< constant part of the lease time
  std::int64_t period_ns = 20'000'000;  ///< period of claims, and of grants while there are touchers
  std::int64_t idle_ns = 500'000'000;   ///< period of grants while there is no toucher
};

/// The host's part: grants one object to its touchers.
class OwnershipArbiter {
 public:
  OwnershipArbiter(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings, std::int64_t now_ns);

  /// Another host grants the object: until `take_over` there is no grant.
  void stand_by() noexcept;
  /// Grants the object from `from_ns` on. A lease of a toucher whose claims this host has not received must have ended
  /// by then.
  void take_over(std::int64_t from_ns) noexcept { first_grant_ns_ = from_ns; }
  [[nodiscard]] bool stands_by() const noexcept { return first_grant_ns_ == kNever; }

  /// Starts, renews or ends the lease of the claim's sender.
  void on_claim(const ObjectClaim& claim, std::int64_t now_ns);
  /// Reports the fencing number of a pose or claim of another program. Returns whether it is the largest so far: then
  /// another host has granted the object.
  bool on_pose(std::uint64_t fencing, std::int64_t now_ns);
  /// Forgets the claim numbers of an HRTC that has left the session. Its lease continues until it expires.
  void forget(std::uint64_t participant);
  /// Ends expired leases. Returns the grant to publish now, or none when no grant is due. Call it before
  /// `host_simulates`.
  [[nodiscard]] std::optional<ObjectGrant> tick(std::int64_t now_ns);

  /// Whether the host itself has to simulate the object, under `fencing()`.
  [[nodiscard]] bool host_simulates() const noexcept;
  [[nodiscard]] std::uint64_t fencing() const noexcept { return fencing_; }
  /// Number of claims and fencing numbers dropped because they were outside their windows
  /// (session/sequence_window.hpp).
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }
  /// Number of claims of HRTCs that the object was not granted to, because kMaxTouchers simulated it already. An HRTC
  /// claims again every `period_ns`.
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_; }

 private:
  struct Lease {
    Toucher toucher;
    std::int64_t until_ns;
    std::int64_t transit_ns;  // ObjectClaim::one_way_ns
  };
  /// The claim numbers of one HRTC: an overtaken claim must not bring back a toucher that has released the object.
  struct ClaimSender {
    std::uint64_t participant;
    std::int64_t accepted_ns;  // arrival of its newest accepted claim
    SenderWindow numbers;
  };
  void raise_fencing(std::int64_t now_ns);
  [[nodiscard]] ClaimSender& find_or_add_sender(std::uint64_t participant, std::int64_t now_ns);
  [[nodiscard]] bool accept_number(const ObjectClaim& claim, std::int64_t now_ns);

  Origin self_;
  std::uint64_t object_id_;
  OwnershipSettings settings_;
  static constexpr std::int64_t kNever = INT64_MAX;
  std::int64_t first_grant_ns_;  // a lease that is not in `leases_` may be valid until then
  bool is_granting_ = false;     // since `first_grant_ns_`
  std::uint64_t fencing_ = 0;
  SequenceWindow fencing_window_;           // fencing numbers of claims, of others' poses and of this host
  std::vector<Lease> leases_;               // oldest first
  std::vector<ClaimSender> claim_senders_;  // at most kMaxClaimSenders, all touchers among them
  std::uint64_t implausible_ = 0, refused_ = 0;
  std::int64_t channel_delay_ns_ = 0;
  std::uint32_t sequence_ = 0;
  std::int64_t last_grant_ns_ = 0;
  bool fencing_changed_ = true;  // since the last grant
};

/// An HRTC's part: claims one object while a user touches it, and follows the grants of the host.
class Claimant {
 public:
  enum class Role : std::uint8_t {
    kWatching,    ///< does not touch: shows the poses of the owner
    kRequesting,  ///< touches without a valid lease: simulates for itself and publishes no poses
    kOwner,       ///< is the only toucher: simulates and publishes poses
    kLeader,      ///< simulates one of several copies and publishes poses
    kCopy         ///< simulates one of several copies and publishes no poses
  };

  Claimant(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings);

  /// Sets whether a user of this HRTC touches the object.
  void set_touching(bool touching) noexcept;
  /// Sets ObjectClaim::one_way_ns of later claims.
  void set_one_way(std::int64_t one_way_ns) noexcept { one_way_ns_ = one_way_ns; }
  /// Reports the fencing number of a pose that was accepted.
  void on_pose(std::uint64_t fencing, std::int64_t now_ns) noexcept { (void)admit_fencing(fencing, now_ns); }
  void on_grant(const ObjectGrant& grant, std::int64_t now_ns);
  /// Returns the claim to publish now, or none when no claim is due.
  [[nodiscard]] std::optional<ObjectClaim> tick(std::int64_t now_ns);

  [[nodiscard]] Role role(std::int64_t now_ns) const noexcept;
  /// Fencing number for the poses that an owner or a leader publishes.
  [[nodiscard]] std::uint64_t fencing() const noexcept { return granted_.fencing; }
  /// The newest grant. It lists all copies, also that of this HRTC. A new `fencing` means a new group of copies.
  [[nodiscard]] const ObjectGrant& grant() const noexcept { return granted_; }
  /// Index of this HRTC in the grant; kMaxTouchers: the grant does not list it.
  [[nodiscard]] std::size_t copy_index() const noexcept { return copy_index_; }
  /// Number of grants and poses dropped because their number was outside its window.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  [[nodiscard]] bool admit_fencing(std::uint64_t fencing, std::int64_t now_ns) noexcept;
  Origin self_;
  std::uint64_t object_id_;
  OwnershipSettings settings_;
  bool touching_ = false;
  std::uint32_t sequence_ = 0;
  std::int64_t last_claim_ns_ = 0;
  bool touching_changed_ = false;  // since the last claim
  struct SentClaim {
    std::uint32_t sequence;
    std::int64_t at_ns;
    bool touching;
    std::int64_t lease_ns;
  };
  std::array<SentClaim, 64> sent_claims_{};         // at sequence modulo size
  ObjectGrant granted_;                             // newest accepted grant
  SequenceWindow fencing_window_{kFencingNumbers};  // fencing numbers of grants and poses
  SequenceWindow grant_window_{kClaimNumbers};      // sequences of grants with the fencing number of `granted_`
  std::uint64_t implausible_ = 0;
  std::size_t copy_index_ = kMaxTouchers;
  std::int64_t until_ns_ = 0;  // end of the lease
  std::int64_t one_way_ns_ = 0;
  int release_claims_left_ = 0;  // claims still to send after the release
};

/// Decides which samples from the other copies of an object are accepted, for an HRTC that simulates one copy.
class CopyAdmission {
 public:
  /// Sets the copies whose samples are accepted: the touchers of this grant. Realtime.
  void set_group(const ObjectGrant& grant) noexcept;
  [[nodiscard]] std::uint64_t fencing() const noexcept { return fencing_; }
  /// Returns false for a sample of another group or another author than the grant lists, and for an implausible sample
  /// (session/sequence_window.hpp). Accepts an overtaken sample, because it can fill a gap in the received channels.
  /// Realtime.
  [[nodiscard]] bool accept(const ObjectCopy& copy, std::int64_t now_ns, std::int64_t session_now_ns) noexcept;
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  struct Peer {
    std::uint64_t participant = 0;         // 0: none
    std::int64_t received_ns = INT64_MIN;  // arrival of its last sample
    SenderWindow numbers{kCycleNumbers};
    TimeWindow times;
  };
  std::uint64_t fencing_ = 0;                  // 0: no group
  std::array<Toucher, kMaxTouchers> group_{};  // by copy index
  std::array<Peer, kMaxTouchers> peers_;
  std::uint64_t implausible_ = 0;
};

/// Decides which poses of an object are accepted, for a program that shows the object.
class PoseAdmission {
 public:
  /// Returns false for a pose of a former owner, an overtaken or repeated pose, and an implausible pose
  /// (session/sequence_window.hpp).
  [[nodiscard]] bool accept(const ObjectPose& pose, std::int64_t now_ns) noexcept;
  [[nodiscard]] std::uint64_t fencing() const noexcept { return fencing_window_.newest(); }
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }

 private:
  SequenceWindow fencing_window_{kFencingNumbers};
  SequenceWindow pose_window_{kObjectPoseNumbers};   // sequences under the newest fencing number
  std::uint64_t participant_ = 0, incarnation_ = 0;  // of the owner under that number
  std::uint64_t implausible_ = 0;
};

}  // namespace tactus::session
