#include "study/hand_over.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <variant>
#include <vector>

#include "session/ownership.hpp"
#include "study/way.hpp"

namespace tactus::study {
namespace {

using session::Holder;

constexpr std::uint64_t kSession = 30, kObject = 100;
constexpr std::int64_t kCycleNs = 1'000'000;
constexpr std::size_t kBytes = 250;  // a claim, grant or pose with its heads

using Mail = std::variant<session::ObjectClaim, session::ObjectGrant, session::ObjectPose>;

/// Host or controller.
struct Program {
  session::Origin self;
  session::PoseGate gate;
  std::uint32_t poses = 0;
};

/// A controller with its one user.
struct Controller : Program {
  explicit Controller(const session::Origin& origin) : Program{origin, {}, 0}, holder{origin, kObject, {}} {}
  Holder holder;
  Toucher user;
  bool touching = false;
  std::int64_t change_ns = 0;    // when the user touches or lets go
  std::int64_t touched_ns = -1;  // and is not granted yet
};

}  // namespace

Figures hand_over(const std::vector<Toucher>& users, double seconds, const netem::LinkSettings& link,
                  std::uint64_t seed) {
  std::mt19937_64 random{seed};
  const auto between = [&](double mean) {
    return static_cast<std::int64_t>(std::uniform_real_distribution<double>{0.1 * mean, 1.9 * mean}(random)*1e9);
  };
  std::int64_t now_ns = kCycleNs;
  Program host{{kSession, 1, 1, 0}, {}, 0};
  session::Arbiter arbiter{host.self, kObject, {}, now_ns};
  std::vector<std::unique_ptr<Controller>> controllers;
  for (const Toucher& user : users) {
    controllers.push_back(std::make_unique<Controller>(session::Origin{kSession, controllers.size() + 2, 1, 0}));
    controllers.back()->user = user;
    controllers.back()->change_ns = now_ns + between(user.pause);
    controllers.back()->holder.set_one_way(static_cast<std::int64_t>(link.forth.delay_ms * 1e6));
  }
  const std::size_t places = users.size() + 1;  // the host's is the first
  std::vector<std::vector<Way<Mail>>> ways(places);
  for (std::size_t from = 0; from < places; ++from)
    for (std::size_t to = 0; to < places; ++to)
      ways[from].emplace_back(from < to ? link.forth : link.back, seed * 1024 + from * 32 + to);
  const auto tell = [&](std::size_t from, const Mail& mail) {
    for (std::size_t to = 0; to < places; ++to)
      if (to != from) ways[from][to].send(now_ns, mail, kBytes);
  };

  std::map<std::uint64_t, std::uint64_t> publishers;  // by fencing number, the first who used it
  std::size_t doubled = 0, nobody = 0, several = 0, touches = 0, ms = 0;
  std::vector<double> waits;  // ms
  const auto publish = [&](std::size_t place, Program& program, std::uint64_t fencing) {
    doubled += publishers.try_emplace(fencing, program.self.participant).first->second != program.self.participant;
    session::ObjectPose pose;
    pose.origin = program.self;
    pose.object_id = kObject;
    pose.fencing = fencing;
    pose.sequence = ++program.poses;
    (void)program.gate.accept(pose, now_ns);
    tell(place, pose);
  };
  for (const std::int64_t end_ns = now_ns + static_cast<std::int64_t>(seconds * 1e9); now_ns < end_ns;
       now_ns += kCycleNs, ++ms) {
    for (std::size_t from = 1; from < places; ++from) {
      while (const auto mail = ways[from][0].take(now_ns)) {
        if (const auto* const claim = std::get_if<session::ObjectClaim>(&*mail)) arbiter.on_claim(*claim, now_ns);
        const auto* const pose = std::get_if<session::ObjectPose>(&*mail);
        if (pose != nullptr && host.gate.accept(*pose, now_ns)) arbiter.on_pose(pose->fencing, now_ns);
      }
    }
    std::size_t publishing = 0;
    if (const auto grant = arbiter.tick(now_ns)) tell(0, *grant);
    if (arbiter.owns(now_ns)) {
      ++publishing;
      publish(0, host, arbiter.fencing());
    }
    for (std::size_t place = 1; place < places; ++place) {
      Controller& one = *controllers[place - 1];
      for (std::size_t from = 0; from < places; ++from) {
        if (from == place) continue;
        while (const auto mail = ways[from][place].take(now_ns)) {
          if (const auto* const grant = std::get_if<session::ObjectGrant>(&*mail)) one.holder.on_grant(*grant, now_ns);
          const auto* const pose = std::get_if<session::ObjectPose>(&*mail);
          if (pose != nullptr && one.gate.accept(*pose, now_ns)) one.holder.on_pose(pose->fencing, now_ns);
        }
      }
      if (now_ns >= one.change_ns) {
        one.touching = !one.touching;
        one.holder.touch(one.touching);
        one.change_ns = now_ns + between(one.touching ? one.user.hold : one.user.pause);
        touches += one.touching ? 1 : 0;
        one.touched_ns = one.touching ? now_ns : -1;
      }
      if (const auto claim = one.holder.tick(now_ns)) ways[place][0].send(now_ns, *claim, kBytes);
      const Holder::Role role = one.holder.role(now_ns);
      if (one.touched_ns >= 0 && role != Holder::Role::kRequesting) {
        waits.push_back(static_cast<double>(now_ns - one.touched_ns) * 1e-6);
        one.touched_ns = -1;
      }
      if (role != Holder::Role::kOwner && role != Holder::Role::kLeader) continue;
      ++publishing;
      publish(place, one, one.holder.fencing());
    }
    nobody += publishing == 0 ? 1 : 0;
    several += publishing > 1 ? 1 : 0;
  }
  std::sort(waits.begin(), waits.end());
  const auto percent = [&](std::size_t count) { return 100 * static_cast<double>(count) / static_cast<double>(ms); };
  double sum = 0;
  for (const double wait : waits) sum += wait;
  return {{"touches", "", static_cast<double>(touches)},
          {"of these granted", "", static_cast<double>(waits.size())},
          {"granted after, mean", "ms", waits.empty() ? 0 : sum / static_cast<double>(waits.size())},
          {"granted after, longest", "ms", waits.empty() ? 0 : waits.back()},
          {"nobody publishes", "%", percent(nobody)},
          {"a former owner publishes too", "%", percent(several)},
          {"two under one number", "", static_cast<double>(doubled)},
          {"hand-overs", "", static_cast<double>(publishers.size())}};
}

}  // namespace tactus::study
