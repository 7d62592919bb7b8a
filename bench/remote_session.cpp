#include "bench/remote_session.hpp"

#include <numeric>
#include <stdexcept>

#include "study/membership_exchange.hpp"

namespace tactus::bench {
namespace {

constexpr std::int64_t kCycleNs = 1'000'000;
constexpr std::uint64_t kTickCycles = 2;
constexpr std::int64_t kLinkStepNs = 250'000;
constexpr double kHeaderBytes = 170;  // headers of a chunk: Ethernet, IP, UDP, RTPS, Tactus

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
      host_{session::Origin{kSession, kHost, 1, 0}, host_service::host_of("object", encoded_.compressed()), now_ns_},
      core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings(settings)},
      membership_{session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session"}, core_.gateway(), now_ns_},
      untouched_bytes_(model.regions.size(), 0) {
  study::exchange_membership(host_, membership_, now_ns_);
}

void RemoteSession::run_link(std::int64_t until_ns) {
  const auto half_trip_ns = static_cast<std::int64_t>(settings_.round_trip / 2 * 1e9);
  while (auto demand = core_.gateway().demand(now_ns_))
    demands_.push_back({now_ns_ + half_trip_ns, std::move(*demand)});
  for (; now_ns_ < until_ns; now_ns_ += kLinkStepNs) {
    while (!demands_.empty() && demands_.front().due_ns <= now_ns_) {
      host_.on_demand(demands_.front().demand, now_ns_);
      demands_.pop_front();
    }
    while (link_free_ns_ <= now_ns_) {
      auto out = host_.next_chunk(now_ns_);
      if (!out) break;
      const double bits = 8 * (static_cast<double>(out->chunk.payload_bytes()) + kHeaderBytes);
      link_free_ns_ =
          std::max(link_free_ns_, now_ns_ - kLinkStepNs) + static_cast<std::int64_t>(bits / settings_.rate * 1e9);
      chunks_.push_back({link_free_ns_ + half_trip_ns, std::move(out->chunk)});
    }
    while (!chunks_.empty() && chunks_.front().due_ns <= now_ns_) {
      const session::BulkChunk& chunk = chunks_.front().chunk;
      for (const session::BulkPiece& piece : chunk.pieces) {
        if (piece.region >= session::kFirstPage) continue;  // base mesh, or a part of the directory
        std::uint64_t& untouched_bytes = untouched_bytes_[piece.region];
        if (piece.index == 0) {
          traffic_.unused_bytes += untouched_bytes;
          untouched_bytes = 0;
          ++traffic_.regions;
        }
        untouched_bytes += piece.payload.size();
        traffic_.bytes += piece.payload.size();
      }
      core_.gateway().on_chunk(chunk, now_ns_);
      chunks_.pop_front();
    }
  }
}

const hrtc_service::ProbeOutput& RemoteSession::run_cycle() {
  ++cycles_;
  run_link(now_ns_ + kCycleNs);
  if (cycles_ % kTickCycles == 0) {
    core_.gateway().tick(now_ns_, membership_.clock());
    membership_.tick(now_ns_);
    study::exchange_membership(host_, membership_, now_ns_);
  }
  core_.tick_intake();
  hrtc_service::Servo& servo = core_.servo();
  servo.refine(spm::Budget{settings_.budget});
  servo.touch(inputs_, now_ns_);
  servo.publish(now_ns_, now_ns_ + kCycleNs);
  const hrtc_service::CycleResult& result = servo.cycle().result();
  budget_spent_ += result.budget_spent ? 1 : 0;
  nodes_full_ += result.nodes_full ? 1 : 0;
  return result.probes[0];
}

void RemoteSession::start() {
  constexpr int kMaxCycles = 60000;
  for (int i = 0; i < kMaxCycles; ++i) {
    run_cycle();
    if (!core_.servo().cycle().objects().empty() && forest().is_base_shown()) return;
  }
  throw std::runtime_error("the base mesh was not shown within a minute; check that it fits the pool");
}

const hrtc_service::ProbeOutput& RemoteSession::step(const spm::Vec3d& tip) {
  hrtc_service::ProbeInput& input = inputs_[0];
  input.device.velocity = input.active ? spm::Vec3d{(tip - last_tip_) * (1e9 / kCycleNs)} : spm::Vec3d::Zero();
  input.active = true;
  input.device.position = tip;
  last_tip_ = tip;
  const hrtc_service::ProbeOutput& output = run_cycle();
  forest().grid().for_each_intersecting(to_model(tip), settings_.radius / scale_,
                                        [&](spm::RegionId region, double) { untouched_bytes_[index(region)] = 0; });
  return output;
}

RemoteSession::Traffic RemoteSession::traffic() const {
  Traffic traffic = traffic_;
  traffic.unused_bytes = std::accumulate(untouched_bytes_.begin(), untouched_bytes_.end(), traffic.unused_bytes);
  return traffic;
}

}  // namespace tactus::bench
