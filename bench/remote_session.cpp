#include "bench/remote_session.hpp"

#include <numeric>
#include <stdexcept>

#include "study/membership_exchange.hpp"

namespace tactus::bench {
namespace {

constexpr std::int64_t kCycleNs = 1'000'000;
constexpr std::uint64_t kTickEvery = 2;         // cycles
constexpr std::int64_t kNetworkStep = 250'000;  // ns
constexpr double kOverhead = 170;  // bytes of headers that a chunk brings along: Ethernet, IP, UDP, RTPS, ours

hrtc_service::HrtcCoreSettings core_settings(const RemoteSettings& settings) {
  hrtc_service::HrtcCoreSettings core;
  core.pool = settings.pool;
  core.servo.cycle.radius = settings.radius;
  core.gateway.loader = settings.loader;
  return core;
}

}  // namespace

RemoteSession::RemoteSession(const spm::Model& model, const RemoteSettings& settings)
    : settings_{settings},
      scale_{model.summary.metres_per_unit},
      encoded_{model},
      host_{session::Origin{kSession, kHost, 1, 0}, host_service::host_of("object", encoded_.coded()), now_},
      core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings(settings)},
      membership_{session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session"}, core_.gateway(), now_},
      unmet_(model.regions.size(), 0) {
  study::exchange_membership(host_, membership_, now_);
}

void RemoteSession::network(std::int64_t until) {
  const auto half = static_cast<std::int64_t>(settings_.round_trip / 2 * 1e9);
  while (auto demand = core_.gateway().demand(now_)) questions_.push_back({now_ + half, std::move(*demand)});
  for (; now_ < until; now_ += kNetworkStep) {
    while (!questions_.empty() && questions_.front().due <= now_) {
      host_.on_demand(questions_.front().demand, now_);
      questions_.pop_front();
    }
    while (link_free_ <= now_) {
      auto out = host_.next_chunk(now_);
      if (!out) break;
      const double bits = 8 * (static_cast<double>(out->chunk.payload_bytes()) + kOverhead);
      link_free_ = std::max(link_free_, now_ - kNetworkStep) + static_cast<std::int64_t>(bits / settings_.rate * 1e9);
      chunks_.push_back({link_free_ + half, std::move(out->chunk)});
    }
    while (!chunks_.empty() && chunks_.front().due <= now_) {
      const session::BulkChunk& chunk = chunks_.front().chunk;
      for (const session::BulkPiece& piece : chunk.pieces) {
        if (piece.region == spm::kNone) continue;
        std::uint64_t& unmet = unmet_[piece.region];
        if (piece.part == 0) {
          traffic_.unused += unmet;
          unmet = 0;
          ++traffic_.regions;
        }
        unmet += piece.payload.size();
        traffic_.bytes += piece.payload.size();
      }
      core_.gateway().on_chunk(chunk, now_);
      chunks_.pop_front();
    }
  }
}

const hrtc_service::ProbeOutput& RemoteSession::run_cycle() {
  ++cycles_;
  network(now_ + kCycleNs);
  if (cycles_ % kTickEvery == 0) {
    core_.gateway().tick(now_, membership_.clock());
    membership_.tick(now_);
    study::exchange_membership(host_, membership_, now_);
  }
  hrtc_service::Servo& servo = core_.servo();
  servo.refine(spm::Budget{settings_.budget});
  servo.touch(inputs_, now_);
  servo.publish(now_, now_ + kCycleNs);
  const hrtc_service::CycleResult& result = servo.cycle().result();
  budget_spent_ += result.budget_spent ? 1 : 0;
  nodes_full_ += result.nodes_full ? 1 : 0;
  return result.probes[0];
}

void RemoteSession::start() {
  constexpr int kPatience = 60000;  // cycles
  for (int i = 0; i < kPatience; ++i) {
    run_cycle();
    if (!core_.servo().cycle().objects().empty() && forest().base_shown()) return;
  }
  throw std::runtime_error("the base mesh did not come within a minute: does it fit the pool?");
}

const hrtc_service::ProbeOutput& RemoteSession::step(const spm::Vec3d& tip) {
  hrtc_service::ProbeInput& input = inputs_[0];
  input.device.velocity = input.active ? spm::Vec3d{(tip - last_tip_) * (1e9 / kCycleNs)} : spm::Vec3d::Zero();
  input.active = true;
  input.device.position = tip;
  last_tip_ = tip;
  const hrtc_service::ProbeOutput& output = run_cycle();
  forest().grid().for_each_meeting(to_model(tip), settings_.radius / scale_,
                                   [&](spm::RegionId region, double) { unmet_[index(region)] = 0; });
  return output;
}

RemoteSession::Traffic RemoteSession::traffic() const {
  Traffic traffic = traffic_;
  traffic.unused = std::accumulate(unmet_.begin(), unmet_.end(), traffic.unused);
  return traffic;
}

}  // namespace tactus::bench
