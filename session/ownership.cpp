#include "session/ownership.hpp"

namespace tactus::session {

namespace {

constexpr std::size_t kMaxClaimants = 64;

/// The lease of a claim with this transit to the host, if the grant takes as long on its way back.
std::int64_t lease_of(const OwnershipSettings& settings, std::int64_t one_way_ns) noexcept {
  constexpr std::int64_t kLongestNs = 500'000'000;
  return settings.lease_ns + 2 * std::clamp<std::int64_t>(one_way_ns, 0, kLongestNs);
}

template <class List, class Id>
auto find_participant(List& list, std::uint64_t participant, Id id) {
  return std::find_if(list.begin(), list.end(), [&](const auto& entry) { return id(entry) == participant; });
}

}  // namespace

Arbiter::Arbiter(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings, std::int64_t now_ns,
                 std::uint64_t fencing)
    : self_{self},
      object_id_{object_id},
      settings_{settings},
      quiet_until_ns_{now_ns + settings.lease_ns},
      fencing_{fencing},
      fencings_{kFencingNumbers, std::max(fencing, self.incarnation), now_ns} {
  if (fencing_ != 0) change(now_ns);
}

void Arbiter::change(std::int64_t now_ns) {
  // Larger than any number that this host may have granted in an earlier incarnation.
  fencing_ = std::max(fencing_, self_.incarnation) + 1;
  (void)fencings_.admit(fencing_, now_ns);
  changed_ = true;
  channel_delay_ns_ = 0;
  for (const Held& held : held_) channel_delay_ns_ = std::max(channel_delay_ns_, held.one_way_ns);
}

void Arbiter::on_pose(std::uint64_t fencing, std::int64_t now_ns) {
  if (fencing <= fencing_) return;
  const Admission admission = fencings_.admit(fencing, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  if (!accepted(admission)) return;
  fencing_ = fencing;
  change(now_ns);
}

bool Arbiter::is_newer(const ObjectClaim& claim, std::int64_t now_ns) {
  const std::uint64_t participant = claim.origin.participant;
  auto at = find_participant(claimants_, participant, [](const Claimant& c) { return c.participant; });
  if (at == claimants_.end()) {
    if (claimants_.size() == kMaxClaimants) {
      const auto holds = [&](const Claimant& c) {
        return std::any_of(held_.begin(), held_.end(),
                           [&](const Held& h) { return h.toucher.participant == c.participant; });
      };
      claimants_.erase(std::min_element(claimants_.begin(), claimants_.end(), [&](const auto& a, const auto& b) {
        return std::make_pair(holds(a), a.seen_ns) < std::make_pair(holds(b), b.seen_ns);
      }));
    }
    at = claimants_.insert(claimants_.end(), {participant, now_ns, SenderWindow{kClaimNumbers}});
  }
  const Admission admission = at->claims.admit(claim.origin, claim.sequence, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  if (accepted(admission)) at->seen_ns = now_ns;
  return accepted(admission);
}

void Arbiter::forget(std::uint64_t participant) {
  const auto gone = find_participant(claimants_, participant, [](const Claimant& c) { return c.participant; });
  if (gone != claimants_.end()) claimants_.erase(gone);
}

void Arbiter::on_claim(const ObjectClaim& claim, std::int64_t now_ns) {
  if (claim.object_id != object_id_ || claim.origin.session != self_.session) return;
  on_pose(claim.fencing, now_ns);
  if (!is_newer(claim, now_ns)) return;
  const std::uint64_t participant = claim.origin.participant;
  const auto held = find_participant(held_, participant, [](const Held& h) { return h.toucher.participant; });
  const Toucher toucher{participant, claim.origin.incarnation, claim.sequence};
  if (held != held_.end() && (!claim.touching || held->toucher.incarnation != toucher.incarnation)) {
    held_.erase(held);
    change(now_ns);
  } else if (held != held_.end()) {
    // Never shortens the lease of an earlier claim.
    const std::int64_t until_ns = std::max(held->until_ns, now_ns + lease_of(settings_, claim.one_way_ns));
    *held = {toucher, until_ns, claim.one_way_ns};
    return;
  }
  if (!claim.touching || held_.size() == kMaxTouchers) return;
  held_.push_back({toucher, now_ns + lease_of(settings_, claim.one_way_ns), claim.one_way_ns});
  change(now_ns);
}

std::optional<ObjectGrant> Arbiter::tick(std::int64_t now_ns) {
  const auto over =
      std::remove_if(held_.begin(), held_.end(), [&](const Held& held) { return held.until_ns <= now_ns; });
  if (over != held_.end()) {
    held_.erase(over, held_.end());
    change(now_ns);
  }
  const std::int64_t period_ns = held_.empty() ? settings_.idle_ns : settings_.period_ns;
  if (now_ns < quiet_until_ns_ || (!changed_ && now_ns - granted_ns_ < period_ns)) return std::nullopt;
  if (fencing_ == 0) change(now_ns);
  changed_ = false;
  granted_ns_ = now_ns;
  ObjectGrant grant;
  grant.origin = self_;
  grant.origin.time_ns = now_ns;
  grant.object_id = object_id_;
  grant.sequence = ++sequence_;
  grant.fencing = fencing_;
  grant.channel_delay_ns = channel_delay_ns_;
  for (const Held& held : held_) grant.touchers.push_back(held.toucher);
  return grant;
}

bool Arbiter::owns(std::int64_t now_ns) const noexcept {
  return now_ns >= quiet_until_ns_ && held_.empty() && fencing_ != 0;
}

Holder::Holder(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings)
    : self_{self}, object_id_{object_id}, settings_{settings} {}

void Holder::touch(bool touching) noexcept {
  if (touching == touching_) return;
  touching_ = touching;
  changed_ = true;
  until_ns_ = 0;
  sent_ = {};  // a grant for a claim of an earlier touch must not count for this one
  // Repeated until the host has certainly received one, or the lease has ended.
  release_claims_ = touching ? 0 : static_cast<int>(lease_of(settings_, one_way_ns_) / settings_.period_ns) + 1;
}

bool Holder::admit_fencing(std::uint64_t fencing, std::int64_t now_ns) noexcept {
  const Admission admission = fencings_.admit(fencing, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  return accepted(admission);
}

void Holder::on_grant(const ObjectGrant& grant, std::int64_t now_ns) {
  if (grant.object_id != object_id_ || grant.origin.session != self_.session || !admit_fencing(grant.fencing, now_ns))
    return;
  const bool known = grant.fencing == granted_.fencing;
  // Two hosts granted the same number: the second one is outdated. The next claim carries a larger number.
  if (known && grant.origin.incarnation != granted_.origin.incarnation) {
    (void)admit_fencing(grant.fencing + 1, now_ns);
    return;
  }
  if (!known) grants_ = SequenceWindow{kClaimNumbers};
  const Admission admission = grants_.admit(grant.sequence, now_ns);
  implausible_ += admission == Admission::kImplausible ? 1 : 0;
  if (!accepted(admission)) return;
  granted_ = grant;
  copy_index_ = kMaxTouchers;
  for (std::size_t i = 0; i < grant.touchers.size() && i < kMaxTouchers; ++i) {
    const Toucher& toucher = grant.touchers[i];
    if (toucher.participant != self_.participant || toucher.incarnation != self_.incarnation) continue;
    copy_index_ = i;
    const Sent& sent = sent_[toucher.claim % sent_.size()];
    if (touching_ && sent.sequence == toucher.claim && sent.touching && sent.at_ns <= now_ns)
      until_ns_ = std::max(until_ns_, sent.at_ns + sent.lease_ns);
  }
}

std::optional<ObjectClaim> Holder::tick(std::int64_t now_ns) {
  if (!touching_ && release_claims_ == 0) return std::nullopt;
  if (!changed_ && now_ns - claimed_ns_ < settings_.period_ns) return std::nullopt;
  changed_ = false;
  claimed_ns_ = now_ns;
  if (!touching_) --release_claims_;
  ObjectClaim claim;
  claim.origin = self_;
  claim.origin.time_ns = now_ns;
  claim.object_id = object_id_;
  claim.sequence = ++sequence_;
  claim.touching = touching_;
  claim.fencing = fencings_.confirmed() ? fencings_.newest() : 0;
  claim.one_way_ns = one_way_ns_;
  sent_[sequence_ % sent_.size()] = {sequence_, now_ns, touching_, lease_of(settings_, one_way_ns_)};
  return claim;
}

Holder::Role Holder::role(std::int64_t now_ns) const noexcept {
  if (!touching_) return Role::kWatching;
  if (copy_index_ == kMaxTouchers || now_ns >= until_ns_ || granted_.fencing < fencings_.newest())
    return Role::kRequesting;
  if (granted_.touchers.size() == 1) return Role::kOwner;
  return copy_index_ == 0 ? Role::kLeader : Role::kCopy;
}

bool CopyGate::accept(const ObjectCopy& copy, std::int64_t now_ns, std::int64_t session_now_ns) noexcept {
  auto at = find_participant(peers_, copy.origin.participant, [](const Peer& peer) { return peer.participant; });
  if (at == peers_.end()) {
    at = std::min_element(peers_.begin(), peers_.end(),
                          [](const Peer& a, const Peer& b) { return a.seen_ns < b.seen_ns; });
    *at = Peer{};
    at->participant = copy.origin.participant;
  }
  at->seen_ns = now_ns;
  const Admission number = at->numbers.admit(copy.origin, copy.sequence, now_ns);
  const Admission time =
      number == Admission::kImplausible ? number : at->times.admit(copy.session_time_ns, session_now_ns);
  implausible_ += time == Admission::kImplausible ? 1 : 0;
  return time != Admission::kImplausible;
}

bool PoseGate::accept(const ObjectPose& pose, std::int64_t now_ns) noexcept {
  const std::uint64_t before = fencings_.newest();
  const Admission fencing = fencings_.admit(pose.fencing, now_ns);
  implausible_ += fencing == Admission::kImplausible ? 1 : 0;
  if (!accepted(fencing)) return false;
  if (fencing == Admission::kAnew || pose.fencing != before) {
    poses_ = SequenceWindow{kObjectPoseNumbers};
    participant_ = pose.origin.participant;
    incarnation_ = pose.origin.incarnation;
  } else if (pose.origin.participant != participant_ || pose.origin.incarnation != incarnation_) {
    return false;  // one number has one author
  }
  const Admission number = poses_.admit(pose.sequence, now_ns);
  implausible_ += number == Admission::kImplausible ? 1 : 0;
  return accepted(number);
}

}  // namespace tactus::session
