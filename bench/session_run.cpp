#include "bench/session_run.hpp"

#include <stdexcept>

#include "study/membership_exchange.hpp"

namespace tactus::bench {
namespace {

constexpr std::uint64_t kHost = 10, kHrtc = 20, kSession = 30;

host_service::HostCoreSettings host_settings(const spm::codec::EncodedModel& model, double scale,
                                             const session::Material& material) {
  host_service::HostCoreSettings settings = host_service::host_of("object", model.compressed());
  settings.objects.front().config.scale = scale;
  settings.objects.front().config.material = material;
  return settings;
}

hrtc_service::HrtcCoreSettings core_settings(const SessionSettings& settings) {
  hrtc_service::HrtcCoreSettings core;
  core.pool = settings.pool;
  core.servo.cycle = settings.cycle;
  core.servo.specs.fill(settings.device);
  core.gateway.loader = settings.loader;
  return core;
}

}  // namespace

SessionRun::SessionRun(const spm::Model& model, double scale, const SessionSettings& settings)
    : delay_{settings.delay_cycles},
      encoded_{model},
      host_{session::Origin{kSession, kHost, 1, 0}, host_settings(encoded_, scale, settings.material), now_},
      core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings(settings)},
      membership_{session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session"}, core_.gateway(), now_} {
  study::exchange_membership(host_, membership_, now_);
}

void SessionRun::settle(const spm::Vec3d& away) {
  constexpr int kMaxCycles = 20000;
  const auto ready = [&] { return !haptic().objects().empty() && haptic().objects().front()->forest->is_base_shown(); };
  for (int i = 0; i < kMaxCycles; ++i) {
    prepare(away, spm::Vec3d::Zero());
    (void)cycle(spm::Budget{1u << 20});
    if (ready()) return;
  }
  throw std::runtime_error("the base mesh does not fit the pool of " + std::to_string(core_.pool().settings.slots) +
                           " slots");
}

void SessionRun::prepare(const spm::Vec3d& tip, const spm::Vec3d& velocity, const Eigen::Quaterniond& orientation) {
  now_ += kPeriodNs;
  ++cycles_;
  loader_us_ = 0;
  loads_.clear();
  if (cycles_ % 2 == 0) exchange();
  inputs_[0].active = true;
  inputs_[0].device.position = tip;
  inputs_[0].device.velocity = velocity;
  inputs_[0].device.orientation = orientation;
}

void SessionRun::prepare_second(const spm::Vec3d& tip, const spm::Vec3d& velocity) {
  inputs_[1].active = true;
  inputs_[1].device.position = tip;
  inputs_[1].device.velocity = velocity;
}

void SessionRun::exchange() {
  hrtc_service::Gateway& gateway = core_.gateway();
  membership_.tick(now_);
  study::exchange_membership(host_, membership_, now_);
  double mark = thread_cpu_us();
  const auto lap = [&mark] {
    const double before = mark;
    mark = thread_cpu_us();
    return mark - before;
  };
  gateway.tick(now_, membership_.clock());
  core_.tick_intake();
  while (auto demand = gateway.demand(now_)) demands_.push_back({cycles_ + delay_, std::move(*demand)});
  loader_us_ += lap();
  while (!demands_.empty() && demands_.front().due <= cycles_) {
    host_.on_demand(demands_.front().sample, now_);
    demands_.pop_front();
  }
  while (auto chunk = host_.next_chunk(now_)) chunks_.push_back({cycles_ + delay_, std::move(chunk->chunk)});
  (void)lap();
  while (!chunks_.empty() && chunks_.front().due <= cycles_) {
    const spm::CacheCounters before = core_.intake().objects().cache().counters();
    const std::uint64_t messages = loader().delivery_counters().messages;
    gateway.on_chunk(chunks_.front().sample, now_);
    core_.tick_intake();
    const double us = lap();
    loader_us_ += us;
    const spm::CacheCounters after = core_.intake().objects().cache().counters();
    if (loader().delivery_counters().messages != messages && after.records_accepted != before.records_accepted)
      loads_.push_back(
          {after.records_accepted + after.records_repeated - before.records_accepted - before.records_repeated, us});
    chunks_.pop_front();
    (void)lap();
  }
}

void SessionRun::touch() noexcept {
  core_.servo().touch(inputs_, now_);
  core_.servo().publish(now_, now_ + kPeriodNs);
}

const hrtc_service::CycleResult& SessionRun::cycle(spm::Budget budget) noexcept {
  core_.servo().refine(budget);
  touch();
  return haptic().result();
}

const hrtc_service::CycleResult& SessionRun::cycle(const hrtc_service::RefineLimit& limit) noexcept {
  touch();
  return core_.servo().refine(spm::Budget{1u << 20}, limit);
}

}  // namespace tactus::bench
