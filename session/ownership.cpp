#include "session/ownership.hpp"

namespace tactus::session {

namespace {

constexpr std::size_t kMaxLetGo = 64;

/// Whether a claim is news about that program; ids are of one participant.
bool newer(const Origin& origin, std::uint32_t sequence, const Toucher& than) noexcept {
  return origin.incarnation != than.incarnation ? origin.incarnation > than.incarnation : sequence > than.claim;
}

/// From a claim with that way to the host and as long a one back.
std::int64_t lease_of(const OwnershipSettings& settings, std::int64_t one_way_ns) noexcept {
  constexpr std::int64_t kLongestNs = 500'000'000;
  return settings.lease_ns + 2 * std::clamp<std::int64_t>(one_way_ns, 0, kLongestNs);
}

template <class List, class Id>
auto find_participant(List& list, std::uint64_t participant, Id id) {
  return std::find_if(list.begin(), list.end(), [&](const auto& entry) { return id(entry) == participant; });
}

}  // namespace

Arbiter::Arbiter(const Origin& self, std::uint64_t object_id, const OwnershipSettings& settings, std::int64_t now_ns)
    : self_{self}, object_id_{object_id}, settings_{settings}, quiet_until_ns_{now_ns + settings.lease_ns} {}

void Arbiter::change() {
  // Larger than any number that this host may have given in an earlier life and nobody has told it of.
  fencing_ = std::max(fencing_, self_.incarnation) + 1;
  changed_ = true;
  line_ns_ = 0;
  for (const Held& held : held_) line_ns_ = std::max(line_ns_, held.one_way_ns);
}

void Arbiter::on_pose(std::uint64_t fencing) {
  if (fencing <= fencing_) return;
  fencing_ = fencing;
  change();
}

void Arbiter::forget(std::uint64_t participant) {
  const auto gone = find_participant(let_go_, participant, [](const Toucher& t) { return t.participant; });
  if (gone != let_go_.end()) let_go_.erase(gone);
}

void Arbiter::on_claim(const ObjectClaim& claim, std::int64_t now_ns) {
  if (claim.object_id != object_id_ || claim.origin.session != self_.session) return;
  on_pose(claim.fencing);
  const std::uint64_t participant = claim.origin.participant;
  const auto held = find_participant(held_, participant, [](const Held& h) { return h.toucher.participant; });
  const auto gone = find_participant(let_go_, participant, [](const Toucher& t) { return t.participant; });
  if (held != held_.end() && !newer(claim.origin, claim.sequence, held->toucher)) return;
  if (gone != let_go_.end() && !newer(claim.origin, claim.sequence, *gone)) return;

  const Toucher toucher{participant, claim.origin.incarnation, claim.sequence};
  if (held != held_.end() && (!claim.touching || held->toucher.incarnation != toucher.incarnation)) {
    held_.erase(held);
    change();
  } else if (held != held_.end()) {
    // No earlier than what an older claim was granted for.
    const std::int64_t until_ns = std::max(held->until_ns, now_ns + lease_of(settings_, claim.one_way_ns));
    *held = {toucher, until_ns, claim.one_way_ns};
    return;
  }
  if (gone != let_go_.end()) let_go_.erase(gone);
  if (!claim.touching) {
    if (let_go_.size() == kMaxLetGo) let_go_.erase(let_go_.begin());
    let_go_.push_back(toucher);
  } else if (held_.size() < kMaxTouchers) {
    held_.push_back({toucher, now_ns + lease_of(settings_, claim.one_way_ns), claim.one_way_ns});
    change();
  }
}

std::optional<ObjectGrant> Arbiter::tick(std::int64_t now_ns) {
  const auto over = std::remove_if(held_.begin(), held_.end(), [&](const Held& held) {
    if (held.until_ns > now_ns) return false;
    if (let_go_.size() == kMaxLetGo) let_go_.erase(let_go_.begin());
    let_go_.push_back(held.toucher);
    return true;
  });
  if (over != held_.end()) {
    held_.erase(over, held_.end());
    change();
  }
  const std::int64_t period_ns = held_.empty() ? settings_.idle_ns : settings_.period_ns;
  if (now_ns < quiet_until_ns_ || (!changed_ && now_ns - granted_ns_ < period_ns)) return std::nullopt;
  if (fencing_ == 0) change();
  changed_ = false;
  granted_ns_ = now_ns;
  ObjectGrant grant;
  grant.origin = self_;
  grant.origin.time_ns = now_ns;
  grant.object_id = object_id_;
  grant.sequence = ++sequence_;
  grant.fencing = fencing_;
  grant.line_ns = line_ns_;
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
  sent_ = {};  // a grant that answers a claim of an earlier touch is none for this one
  // Until the host has heard it or the lease is over anyway.
  farewells_ = touching ? 0 : static_cast<int>(lease_of(settings_, one_way_ns_) / settings_.period_ns) + 1;
}

void Holder::on_grant(const ObjectGrant& grant, std::int64_t now_ns) {
  if (grant.object_id != object_id_ || grant.origin.session != self_.session || grant.fencing < seen_) return;
  const bool same = grant.fencing == granted_.fencing && grant.origin.incarnation == granted_.origin.incarnation;
  if (same && grant.sequence <= granted_.sequence) return;
  // One number is granted once: the second who uses it is a host that does not know yet, and is told by the next claim.
  if (!same && grant.fencing == granted_.fencing) {
    seen_ = grant.fencing + 1;
    return;
  }
  granted_ = grant;
  seen_ = grant.fencing;
  place_ = kMaxTouchers;
  for (std::size_t i = 0; i < grant.touchers.size() && i < kMaxTouchers; ++i) {
    const Toucher& toucher = grant.touchers[i];
    if (toucher.participant != self_.participant || toucher.incarnation != self_.incarnation) continue;
    place_ = i;
    const Sent& sent = sent_[toucher.claim % sent_.size()];
    if (touching_ && sent.sequence == toucher.claim && sent.touching && sent.at_ns <= now_ns)
      until_ns_ = std::max(until_ns_, sent.at_ns + sent.lease_ns);
  }
}

std::optional<ObjectClaim> Holder::tick(std::int64_t now_ns) {
  if (!touching_ && farewells_ == 0) return std::nullopt;
  if (!changed_ && now_ns - claimed_ns_ < settings_.period_ns) return std::nullopt;
  changed_ = false;
  claimed_ns_ = now_ns;
  if (!touching_) --farewells_;
  ObjectClaim claim;
  claim.origin = self_;
  claim.origin.time_ns = now_ns;
  claim.object_id = object_id_;
  claim.sequence = ++sequence_;
  claim.touching = touching_;
  claim.fencing = seen_;
  claim.one_way_ns = one_way_ns_;
  sent_[sequence_ % sent_.size()] = {sequence_, now_ns, touching_, lease_of(settings_, one_way_ns_)};
  return claim;
}

Holder::Role Holder::role(std::int64_t now_ns) const noexcept {
  if (!touching_) return Role::kWatching;
  if (place_ == kMaxTouchers || now_ns >= until_ns_ || granted_.fencing < seen_) return Role::kAsking;
  if (granted_.touchers.size() == 1) return Role::kOwner;
  return place_ == 0 ? Role::kLeader : Role::kCopy;
}

bool PoseGate::accept(const ObjectPose& pose) noexcept {
  if (any_ && pose.fencing < fencing_) return false;
  const bool same = pose.origin.participant == participant_ && pose.origin.incarnation == incarnation_;
  if (any_ && pose.fencing == fencing_ && (!same || pose.sequence <= sequence_)) return false;
  any_ = true;
  fencing_ = pose.fencing;
  participant_ = pose.origin.participant;
  incarnation_ = pose.origin.incarnation;
  sequence_ = pose.sequence;
  return true;
}

}  // namespace tactus::session
