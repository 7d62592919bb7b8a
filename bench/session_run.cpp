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

std::array<haptics::DeviceSpec, hrtc_service::kMaxProbes> specs_of(const haptics::DeviceSpec& spec) {
  std::array<haptics::DeviceSpec, hrtc_service::kMaxProbes> specs;
  specs.fill(spec);
  return specs;
}

}  // namespace

double thread_cpu_us() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

SessionRun::SessionRun(const spm::Model& model, double scale, const SessionSettings& settings)
    : delay_{settings.delay_cycles},
      pool_{settings.pool},
      nodes_{settings.pool.tree_nodes},
      encoded_{model},
      server_{session::Origin{kSession, kHost, 1, 0}},
      loader_{pool_, nodes_, session::Origin{kSession, kHrtc, 1, 0}, settings.loader, arrivals_, departures_},
      cycle_{settings.cycle, specs_of(settings.device), departures_, nullptr} {
  server_.add(kObject, encoded_.coded());
  loader_.on_host_seen(kHost, 1, now_);
  loader_.on_catalogue(entry_for(model, scale, settings.material, server_.base_bytes(kObject)));
}

void SessionRun::settle(const spm::Vec3d& away) {
  constexpr int kMaxCycles = 20000;
  const auto ready = [&] { return !cycle_.objects().empty() && cycle_.objects().front()->forest->base_shown(); };
  for (int i = 0; i < kMaxCycles; ++i) {
    prepare(away, spm::Vec3d::Zero());
    (void)cycle(spm::Budget{1u << 20});
    if (ready()) return;
  }
  throw std::runtime_error("the base mesh does not fit the pool of " + std::to_string(pool_.settings.slots) + " slots");
}

void SessionRun::prepare(const spm::Vec3d& tip, const spm::Vec3d& velocity, const Eigen::Quaterniond& orientation) {
  now_ += kPeriodNs;
  ++cycles_;
  loader_us_ = 0;
  loads_.clear();
  if (cycles_ % 2 == 0) exchange(tip);
  inputs_[0].active = true;
  inputs_[0].device.position = tip;
  inputs_[0].device.velocity = velocity;
  inputs_[0].device.orientation = orientation;
  inputs_[0].near = near_[0];
}

void SessionRun::exchange(const spm::Vec3d& tip) {
  std::array<hrtc_service::ProbeSight, hrtc_service::kMaxProbes> sights;
  sights[0] = {true, in_contact_, now_, tip, proxy_, orientation_};
  double mark = thread_cpu_us();
  const auto lap = [&mark] {
    const double before = mark;
    mark = thread_cpu_us();
    return mark - before;
  };
  loader_.on_host_seen(kHost, 1, now_);
  loader_.tick(now_, sights, near_);
  while (auto demand = loader_.demand(now_)) demands_.push_back({cycles_ + delay_, std::move(*demand)});
  loader_us_ += lap();
  while (!demands_.empty() && demands_.front().due <= cycles_) {
    server_.on_demand(demands_.front().sample, now_);
    demands_.pop_front();
  }
  while (auto chunk = server_.next(now_)) chunks_.push_back({cycles_ + delay_, std::move(chunk->chunk)});
  (void)lap();
  while (!chunks_.empty() && chunks_.front().due <= cycles_) {
    const spm::CacheCounters before = loader_.cache_counters();
    const std::uint64_t messages = loader_.delivery_counters().messages;
    loader_.on_chunk(chunks_.front().sample, now_);
    const double us = lap();
    loader_us_ += us;
    const spm::CacheCounters after = loader_.cache_counters();
    if (loader_.delivery_counters().messages != messages && after.records_accepted != before.records_accepted)
      loads_.push_back(
          {after.records_accepted + after.records_repeated - before.records_accepted - before.records_repeated, us});
    chunks_.pop_front();
    (void)lap();
  }
}

const hrtc_service::CycleResult& SessionRun::seen(const hrtc_service::CycleResult& result) noexcept {
  in_contact_ = (result.probes[0].status & session::kInContact) != 0;
  proxy_ = hrtc_service::vec(result.probes[0].proxy);
  orientation_ = hrtc_service::quaternion(result.probes[0].orientation);
  return result;
}

const hrtc_service::CycleResult& SessionRun::cycle(spm::Budget budget) noexcept {
  Arrivals arrived;
  const std::uint32_t count = take(arrived);
  return seen(cycle_.step(inputs_, now_, arrived.data(), count, budget));
}

const hrtc_service::CycleResult& SessionRun::cycle(const hrtc_service::RefineLimit& limit) noexcept {
  Arrivals arrived;
  const std::uint32_t count = take(arrived);
  cycle_.touch(inputs_, now_, arrived.data(), count);
  return seen(cycle_.refine(spm::Budget{1u << 20}, limit));
}

}  // namespace tactus::bench
