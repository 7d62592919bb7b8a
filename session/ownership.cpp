#include "session/ownership.hpp"

namespace tactus::session {

namespace {

constexpr std::size_t kMaxClaimSenders = 64;

/// Lease time for an HRTC whose claims take `transit_ns` to the host. Assumes that grants take as long.
std::int64_t lease_time_ns(const OwnershipSettings& settings, std::int64_t transit_ns) noexcept {
  constexpr std::int64_t kMaxTransitNs = 500'000'000;
  return settings.lease_ns + 2 * std::clamp<std::int64_t>(transit_ns, 0, kMaxTransitNs);
}

/// Number from which a host counts its fencing numbers. A clock does not reach the bound, but a damaged state file may.
std::uint64_t first_fencing(const Origin& host) noexcept { return std::min(host.incarnation, 2 * kMaxFollowedFencing); }

template <class List, class ParticipantOf>
auto find_participant(List& list, std::uint64_t participant, ParticipantOf participant_of) {
  return std::find_if(list.begin(), list.end(),
                      [&](const auto& entry) { return participant_of(entry) == participant; });
}

}  // namespace

OwnershipArbiter::OwnershipArbiter(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings,
                                   std::int64_t now_ns)
    : self_{self},
      object_id_{object_id},
      settings_{settings},
      first_grant_ns_{now_ns + settings.lease_ns},
      fencing_window_{kHostFencingNumbers, first_fencing(self), now_ns} {}

void OwnershipArbiter::stand_by() noexcept {
  first_grant_ns_ = kNever;
  is_granting_ = false;
}

/// Makes a new fencing number and channel delay for the present touchers. The next grant publishes both. Before the
/// first grant, the number of the other host remains, because its leases may be valid.
void OwnershipArbiter::raise_fencing(std::int64_t now_ns) {
  if (!is_granting_) return;
  // Larger than any number that this host may have granted in an earlier incarnation.
  fencing_ = std::max(fencing_, first_fencing(self_)) + 1;
  (void)fencing_window_.admit(fencing_, now_ns);
  fencing_changed_ = true;
  channel_delay_ns_ = 0;
  for (const Lease& lease : leases_) channel_delay_ns_ = std::max(channel_delay_ns_, lease.transit_ns);
}

bool OwnershipArbiter::on_pose(std::uint64_t fencing, std::int64_t now_ns) {
  if (fencing <= fencing_) return false;
  const Admission admission = fencing_window_.admit(fencing, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  if (!accepted(admission)) return false;
  fencing_ = fencing;
  raise_fencing(now_ns);
  return true;
}

/// Returns the entry of a sender of claims, a new one if necessary. If all entries are in use, the new one replaces the
/// entry whose last accepted claim is the oldest, and that of a toucher only if all senders are touchers.
OwnershipArbiter::ClaimSender& OwnershipArbiter::find_or_add_sender(std::uint64_t participant, std::int64_t now_ns) {
  const auto found = find_participant(claim_senders_, participant, [](const ClaimSender& s) { return s.participant; });
  if (found != claim_senders_.end()) return *found;
  if (claim_senders_.size() == kMaxClaimSenders) {
    const auto has_lease = [&](const ClaimSender& sender) {
      return std::any_of(leases_.begin(), leases_.end(),
                         [&](const Lease& lease) { return lease.toucher.participant == sender.participant; });
    };
    claim_senders_.erase(
        std::min_element(claim_senders_.begin(), claim_senders_.end(), [&](const auto& a, const auto& b) {
          return std::make_pair(has_lease(a), a.accepted_ns) < std::make_pair(has_lease(b), b.accepted_ns);
        }));
  }
  return *claim_senders_.insert(claim_senders_.end(), {participant, now_ns, SenderWindow{kClaimNumbers}});
}

/// Returns whether the claim is newer than the others of its sender, and plausible.
bool OwnershipArbiter::accept_number(const ObjectClaim& claim, std::int64_t now_ns) {
  ClaimSender& sender = find_or_add_sender(claim.origin.participant, now_ns);
  const Admission admission = sender.numbers.admit(claim.origin, claim.sequence, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  if (accepted(admission)) sender.accepted_ns = now_ns;
  return accepted(admission);
}

void OwnershipArbiter::forget(std::uint64_t participant) {
  const auto sender = find_participant(claim_senders_, participant, [](const ClaimSender& s) { return s.participant; });
  if (sender != claim_senders_.end()) claim_senders_.erase(sender);
}

void OwnershipArbiter::on_claim(const ObjectClaim& claim, std::int64_t now_ns) {
  if (claim.object_id != object_id_ || claim.origin.session != self_.session) return;
  (void)on_pose(claim.fencing, now_ns);
  if (!accept_number(claim, now_ns)) return;
  const std::uint64_t participant = claim.origin.participant;
  const auto lease = find_participant(leases_, participant, [](const Lease& l) { return l.toucher.participant; });
  const Toucher toucher{participant, claim.origin.incarnation, claim.sequence};
  if (lease != leases_.end() && (!claim.touching || lease->toucher.incarnation != toucher.incarnation)) {
    leases_.erase(lease);
    raise_fencing(now_ns);
  } else if (lease != leases_.end()) {
    // A claim never shortens the lease that an earlier claim of this toucher has begun.
    const std::int64_t until_ns = std::max(lease->until_ns, now_ns + lease_time_ns(settings_, claim.one_way_ns));
    *lease = {toucher, until_ns, claim.one_way_ns};
    return;
  }
  if (!claim.touching) return;
  if (leases_.size() == kMaxTouchers) {
    refused_ += stands_by() ? 0 : 1;
    return;
  }
  leases_.push_back({toucher, now_ns + lease_time_ns(settings_, claim.one_way_ns), claim.one_way_ns});
  raise_fencing(now_ns);
}

std::optional<ObjectGrant> OwnershipArbiter::tick(std::int64_t now_ns) {
  const auto expired =
      std::remove_if(leases_.begin(), leases_.end(), [&](const Lease& lease) { return lease.until_ns <= now_ns; });
  if (expired != leases_.end()) {
    leases_.erase(expired, leases_.end());
    raise_fencing(now_ns);
  }
  if (now_ns < first_grant_ns_) return std::nullopt;
  if (!is_granting_) {
    is_granting_ = true;
    raise_fencing(now_ns);
  }
  const std::int64_t period_ns = leases_.empty() ? settings_.idle_ns : settings_.period_ns;
  if (!fencing_changed_ && now_ns - last_grant_ns_ < period_ns) return std::nullopt;
  fencing_changed_ = false;
  last_grant_ns_ = now_ns;
  ObjectGrant grant;
  grant.origin = self_;
  grant.origin.time_ns = now_ns;
  grant.object_id = object_id_;
  grant.sequence = ++sequence_;
  grant.fencing = fencing_;
  grant.channel_delay_ns = channel_delay_ns_;
  for (const Lease& lease : leases_) grant.touchers.push_back(lease.toucher);
  return grant;
}

bool OwnershipArbiter::host_simulates() const noexcept { return is_granting_ && leases_.empty(); }

Claimant::Claimant(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings)
    : self_{self}, object_id_{object_id}, settings_{settings} {}

void Claimant::set_touching(bool touching) noexcept {
  if (touching == touching_) return;
  touching_ = touching;
  touching_changed_ = true;
  until_ns_ = 0;
  sent_claims_ = {};  // a grant for a claim of an earlier touch must not extend the lease of this touch
  // The release is repeated for one lease time. If the host receives none of these claims, the lease expires.
  release_claims_left_ =
      touching ? 0 : static_cast<int>(lease_time_ns(settings_, one_way_ns_) / settings_.period_ns) + 1;
}

bool Claimant::admit_fencing(std::uint64_t fencing, std::int64_t now_ns) noexcept {
  const Admission admission = fencing_window_.admit(fencing, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  return accepted(admission);
}

void Claimant::on_grant(const ObjectGrant& grant, std::int64_t now_ns) {
  if (grant.object_id != object_id_ || grant.origin.session != self_.session || !admit_fencing(grant.fencing, now_ns))
    return;
  const bool same_fencing = grant.fencing == granted_.fencing;
  // Two hosts granted the same fencing number. The grant of the second host is refused, and the next claim carries a
  // larger number, so that the hosts then grant a larger one.
  if (same_fencing && grant.origin.incarnation != granted_.origin.incarnation) {
    if (grant.fencing < UINT64_MAX) (void)admit_fencing(grant.fencing + 1, now_ns);
    return;
  }
  if (!same_fencing) grant_window_ = SequenceWindow{kClaimNumbers};
  const Admission admission = grant_window_.admit(grant.sequence, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  if (!accepted(admission)) return;
  granted_ = grant;
  copy_index_ = kMaxTouchers;
  for (std::size_t i = 0; i < grant.touchers.size() && i < kMaxTouchers; ++i) {
    const Toucher& toucher = grant.touchers[i];
    if (toucher.participant != self_.participant || toucher.incarnation != self_.incarnation) continue;
    copy_index_ = i;
    const SentClaim& sent = sent_claims_[toucher.claim % sent_claims_.size()];
    if (touching_ && sent.sequence == toucher.claim && sent.touching && sent.at_ns <= now_ns)
      until_ns_ = std::max(until_ns_, sent.at_ns + sent.lease_ns);
  }
}

std::optional<ObjectClaim> Claimant::tick(std::int64_t now_ns) {
  if (!touching_ && release_claims_left_ == 0) return std::nullopt;
  if (!touching_changed_ && now_ns - last_claim_ns_ < settings_.period_ns) return std::nullopt;
  touching_changed_ = false;
  last_claim_ns_ = now_ns;
  if (!touching_) --release_claims_left_;
  ObjectClaim claim;
  claim.origin = self_;
  claim.origin.time_ns = now_ns;
  claim.object_id = object_id_;
  claim.sequence = ++sequence_;
  claim.touching = touching_;
  claim.fencing = fencing_window_.confirmed() ? fencing_window_.newest() : 0;
  claim.one_way_ns = one_way_ns_;
  sent_claims_[sequence_ % sent_claims_.size()] = {sequence_, now_ns, touching_, lease_time_ns(settings_, one_way_ns_)};
  return claim;
}

Claimant::Role Claimant::role(std::int64_t now_ns) const noexcept {
  if (!touching_) return Role::kWatching;
  if (copy_index_ == kMaxTouchers || now_ns >= until_ns_ || granted_.fencing < fencing_window_.newest())
    return Role::kRequesting;
  if (granted_.touchers.size() == 1) return Role::kOwner;
  return copy_index_ == 0 ? Role::kLeader : Role::kCopy;
}

void CopyAdmission::set_group(const ObjectGrant& grant) noexcept {
  fencing_ = grant.fencing;
  group_ = {};
  std::copy_n(grant.touchers.begin(), std::min<std::size_t>(grant.touchers.size(), kMaxTouchers), group_.begin());
}

bool CopyAdmission::accept(const ObjectCopy& copy, std::int64_t now_ns, std::int64_t session_now_ns) noexcept {
  if (fencing_ == 0 || copy.fencing != fencing_ || copy.copy_index >= kMaxTouchers) return false;
  const Toucher& author = group_[copy.copy_index];
  if (author.participant != copy.origin.participant || author.incarnation != copy.origin.incarnation) return false;
  auto at = find_participant(peers_, copy.origin.participant, [](const Peer& peer) { return peer.participant; });
  if (at == peers_.end()) {
    at = std::min_element(peers_.begin(), peers_.end(),
                          [](const Peer& a, const Peer& b) { return a.received_ns < b.received_ns; });
    *at = Peer{};
    at->participant = copy.origin.participant;
  }
  at->received_ns = now_ns;
  Admission admission = at->numbers.admit(copy.origin, copy.sequence, now_ns);
  if (admission != Admission::kImplausible) admission = at->times.admit(copy.session_time_ns, session_now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  return admission != Admission::kImplausible;
}

bool PoseAdmission::accept(const ObjectPose& pose, std::int64_t now_ns) noexcept {
  const std::uint64_t previous_fencing = fencing_window_.newest();
  const Admission fencing_admission = fencing_window_.admit(pose.fencing, now_ns);
  implausible_ += fencing_admission == Admission::kImplausible ? 1 : 0;
  if (!accepted(fencing_admission)) return false;
  if (fencing_admission == Admission::kNewStart || pose.fencing != previous_fencing) {
    pose_window_ = SequenceWindow{kObjectPoseNumbers};
    participant_ = pose.origin.participant;
    incarnation_ = pose.origin.incarnation;
  } else if (pose.origin.participant != participant_ || pose.origin.incarnation != incarnation_) {
    return false;  // only one program may publish poses under a fencing number
  }
  const Admission pose_admission = pose_window_.admit(pose.sequence, now_ns);
  implausible_ += pose_admission == Admission::kImplausible ? 1 : 0;
  return accepted(pose_admission);
}

}  // namespace tactus::session
