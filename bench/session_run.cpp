#include "bench/session_run.hpp"

#include <ctime>
#include <stdexcept>

namespace tactus::bench {
namespace {

constexpr std::uint64_t kHost = 10, kHrtc = 20, kSession = 30, kObject = 100;

session::CatalogueEntry entry_for(const spm::Model& model, double scale, const session::Material& material,
                                  std::uint32_t base_bytes) {
  session::CatalogueEntry entry;
  entry.origin = {kSession, kHost, 1, 0};
  entry.host = "host";
  entry.object = "object";
  entry.object_id = kObject;
  entry.summary = model.summary;
  entry.scale = scale;
  entry.material = material;
  entry.base_bytes = base_bytes;
  return entry;
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

double thread_cpu_us() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

SessionRun::SessionRun(const spm::Model& model, double scale, const SessionSettings& settings)
    : delay_{settings.delay_cycles},
      encoded_{model},
      server_{session::Origin{kSession, kHost, 1, 0}},
      core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings(settings)} {
  server_.add(kObject, encoded_.coded());
  core_.gateway().on_host_seen(kHost, 1, now_);
  core_.gateway().on_catalogue(entry_for(model, scale, settings.material, server_.base_bytes(kObject)));
}

void SessionRun::settle(const spm::Vec3d& away) {
  constexpr int kMaxCycles = 20000;
  const auto ready = [&] { return !haptic().objects().empty() && haptic().objects().front()->forest->base_shown(); };
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

void SessionRun::exchange() {
  hrtc_service::Gateway& gateway = core_.gateway();
  double mark = thread_cpu_us();
  const auto lap = [&mark] {
    const double before = mark;
    mark = thread_cpu_us();
    return mark - before;
  };
  gateway.on_host_seen(kHost, 1, now_);
  gateway.tick(now_, session::ClockMap{});
  while (auto demand = gateway.demand(now_)) demands_.push_back({cycles_ + delay_, std::move(*demand)});
  loader_us_ += lap();
  while (!demands_.empty() && demands_.front().due <= cycles_) {
    server_.on_demand(demands_.front().sample, now_);
    demands_.pop_front();
  }
  while (auto chunk = server_.next(now_)) chunks_.push_back({cycles_ + delay_, std::move(chunk->chunk)});
  (void)lap();
  while (!chunks_.empty() && chunks_.front().due <= cycles_) {
    const spm::CacheCounters before = loader().cache_counters();
    const std::uint64_t messages = loader().delivery_counters().messages;
    gateway.on_chunk(chunks_.front().sample, now_);
    const double us = lap();
    loader_us_ += us;
    const spm::CacheCounters after = loader().cache_counters();
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
