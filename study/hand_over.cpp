#include "study/hand_over.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <variant>
#include <vector>

#include "session/ownership.hpp"
#include "study/constants.hpp"
#include "study/virtual_link.hpp"

namespace tactus::study {
namespace {

using session::Claimant;

constexpr std::uint64_t kObject = 100;
constexpr std::size_t kSampleBytes = 250;  // a claim, grant or pose with headers

using OwnershipSample = std::variant<session::ObjectClaim, session::ObjectGrant, session::ObjectPose>;

/// A host or an HRTC.
struct Program {
  session::Origin self;
  session::PoseAdmission pose_admission;
  std::uint32_t poses = 0;
};

/// An HRTC with its one user.
struct Hrtc : Program {
  explicit Hrtc(const session::Origin& origin) : Program{origin, {}, 0}, claimant{origin, kObject, {}} {}
  Claimant claimant;
  HandOverUser user;
  bool touching = false;
  std::int64_t next_change_ns = 0;  // begin or end of the user's next touch
  std::int64_t requested_ns = -1;   // begin of a touch that waits for its grant; -1: none waits
};

}  // namespace

Figures hand_over(const std::vector<HandOverUser>& users, double seconds, const netem::LinkSettings& link,
                  std::uint64_t seed) {
  std::mt19937_64 random{seed};
  const auto between = [&](double mean) {
    return static_cast<std::int64_t>(std::uniform_real_distribution<double>{0.1 * mean, 1.9 * mean}(random)*1e9);
  };
  std::int64_t now_ns = kCycleNs;
  Program host{{kSession, 1, 1, 0}, {}, 0};
  session::OwnershipArbiter arbiter{host.self, kObject, {}, now_ns};
  std::vector<std::unique_ptr<Hrtc>> hrtcs;
  for (const HandOverUser& user : users) {
    hrtcs.push_back(std::make_unique<Hrtc>(session::Origin{kSession, hrtcs.size() + 2, 1, 0}));
    hrtcs.back()->user = user;
    hrtcs.back()->next_change_ns = now_ns + between(user.pause);
    hrtcs.back()->claimant.set_one_way(static_cast<std::int64_t>(link.a_to_b.delay_ms * 1e6));
  }
  const std::size_t nodes = users.size() + 1;  // the first is the host
  std::vector<std::vector<VirtualLink<OwnershipSample>>> links(nodes);
  for (std::size_t from = 0; from < nodes; ++from)
    for (std::size_t to = 0; to < nodes; ++to)
      links[from].emplace_back(from < to ? link.a_to_b : link.b_to_a, seed * 1024 + from * 32 + to);
  const auto broadcast = [&](std::size_t from, const OwnershipSample& sample) {
    for (std::size_t to = 0; to < nodes; ++to)
      if (to != from) links[from][to].send(now_ns, sample, kSampleBytes);
  };

  std::map<std::uint64_t, std::uint64_t> publishers;  // by fencing number: participant that used it first
  std::size_t doubled = 0, nobody = 0, several = 0, touches = 0, ms = 0;
  std::vector<double> waits;  // ms
  const auto publish = [&](std::size_t node, Program& program, std::uint64_t fencing) {
    doubled += publishers.try_emplace(fencing, program.self.participant).first->second != program.self.participant;
    session::ObjectPose pose;
    pose.origin = program.self;
    pose.object_id = kObject;
    pose.fencing = fencing;
    pose.sequence = ++program.poses;
    (void)program.pose_admission.accept(pose, now_ns);
    broadcast(node, pose);
  };
  for (const std::int64_t end_ns = now_ns + static_cast<std::int64_t>(seconds * 1e9); now_ns < end_ns;
       now_ns += kCycleNs, ++ms) {
    for (std::size_t from = 1; from < nodes; ++from) {
      while (const auto sample = links[from][0].take(now_ns)) {
        if (const auto* const claim = std::get_if<session::ObjectClaim>(&*sample)) arbiter.on_claim(*claim, now_ns);
        const auto* const pose = std::get_if<session::ObjectPose>(&*sample);
        if (pose != nullptr && host.pose_admission.accept(*pose, now_ns)) arbiter.on_pose(pose->fencing, now_ns);
      }
    }
    std::size_t publishing = 0;
    if (const auto grant = arbiter.tick(now_ns)) broadcast(0, *grant);
    if (arbiter.host_simulates()) {
      ++publishing;
      publish(0, host, arbiter.fencing());
    }
    for (std::size_t node = 1; node < nodes; ++node) {
      Hrtc& hrtc = *hrtcs[node - 1];
      for (std::size_t from = 0; from < nodes; ++from) {
        if (from == node) continue;
        while (const auto sample = links[from][node].take(now_ns)) {
          if (const auto* const grant = std::get_if<session::ObjectGrant>(&*sample))
            hrtc.claimant.on_grant(*grant, now_ns);
          const auto* const pose = std::get_if<session::ObjectPose>(&*sample);
          if (pose != nullptr && hrtc.pose_admission.accept(*pose, now_ns))
            hrtc.claimant.on_pose(pose->fencing, now_ns);
        }
      }
      if (now_ns >= hrtc.next_change_ns) {
        hrtc.touching = !hrtc.touching;
        hrtc.claimant.set_touching(hrtc.touching);
        hrtc.next_change_ns = now_ns + between(hrtc.touching ? hrtc.user.hold : hrtc.user.pause);
        touches += hrtc.touching ? 1 : 0;
        hrtc.requested_ns = hrtc.touching ? now_ns : -1;
      }
      if (const auto claim = hrtc.claimant.tick(now_ns)) links[node][0].send(now_ns, *claim, kSampleBytes);
      const Claimant::Role role = hrtc.claimant.role(now_ns);
      if (hrtc.requested_ns >= 0 && role != Claimant::Role::kRequesting) {
        waits.push_back(static_cast<double>(now_ns - hrtc.requested_ns) * 1e-6);
        hrtc.requested_ns = -1;
      }
      if (role != Claimant::Role::kOwner && role != Claimant::Role::kLeader) continue;
      ++publishing;
      publish(node, hrtc, hrtc.claimant.fencing());
    }
    nobody += publishing == 0 ? 1 : 0;
    several += publishing > 1 ? 1 : 0;
  }
  std::sort(waits.begin(), waits.end());
  const auto percent = [&](std::size_t count) { return 100 * static_cast<double>(count) / static_cast<double>(ms); };
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  double sum = 0;
  for (const double wait : waits) sum += wait;
  return {{"touches", "", static_cast<double>(touches)},
          {"granted touches", "", static_cast<double>(waits.size())},
          {"time to grant, mean", "ms", waits.empty() ? kNone : sum / static_cast<double>(waits.size())},
          {"time to grant, max", "ms", waits.empty() ? kNone : waits.back()},
          {"no publisher", "%", percent(nobody)},
          {"several publishers", "%", percent(several)},
          {"shared fencing numbers", "", static_cast<double>(doubled)},
          {"hand-overs", "", static_cast<double>(publishers.size())}};
}

}  // namespace tactus::study
