/// Runs the cores of a host and an HRTC in one thread, without DDS, so that a test can inspect each step of a session.
#pragma once

#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host_service/host_core.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "spm/codec/model_codec.hpp"
#include "study/membership_exchange.hpp"
#include "tests/support/constants.hpp"

namespace tactus::test_support {

class LocalSession {
 public:
  static constexpr std::int64_t kPeriodNs = 1'000'000;

  /// The arrays of `models` must outlive the session. `scale`: metres per file unit. `delay_cycles`: transit of chunks
  /// and demands, in cycles. `loader.tool` is also the tool of the cycle. `mass`: mass of the last object in kg, or 0
  /// if the last object is static; all other objects are static. `targets`: CycleSettings::targets.
  LocalSession(const std::vector<spm::Model>& models, double scale, spm::PoolSettings settings,
               std::uint32_t delay_cycles = 2, const hrtc_service::LoaderSettings& loader = {},
               const session::Material& material = {}, double mass = 0,
               std::uint32_t targets = hrtc_service::CycleSettings{}.targets)
      : models_{models},
        encoded_{models_.begin(), models_.end()},
        host_{session::Origin{kSession, kHost, 1, 0}, host_settings(encoded_, scale, material, mass), now_},
        core_{hrtc_origin(), core_settings(settings, loader, targets)},
        delay_{delay_cycles} {
    join();
  }

  /// Replaces the gateway by a new one, which knows nothing of the session.
  void restart_gateway() {
    ++incarnation_;
    membership_.reset();
    core_.replace_gateway(hrtc_origin());
    demands_.clear();
    chunks_.clear();
    join();
  }

  /// Gives the HRTC a catalogue entry in which the object is withdrawn or offered again.
  void set_withdrawn(std::size_t object, bool withdrawn) {
    session::CatalogueEntry entry = host_.catalogue()[object];
    entry.withdrawn = withdrawn;
    membership_->on_catalogue(entry);
  }

  /// Runs one cycle with one tip at `device` (world frame; m and m/s). Host and loader run in every second cycle.
  /// `units`: refinement budget.
  const hrtc_service::CycleResult& step(const spm::Vec3d& device, const spm::Vec3d& velocity,
                                        std::uint32_t units = 1u << 20) {
    prepare(device, velocity);
    return run_cycle(units);
  }
  /// First half of `step`: the work of all threads except the haptic thread.
  void prepare(const spm::Vec3d& device, const spm::Vec3d& velocity) {
    now_ += kPeriodNs;
    ++cycles_;
    if (cycles_ % 2 == 0 && has_gateway) exchange();
    inputs_[0].active = true;
    inputs_[0].device.position = device;
    inputs_[0].device.velocity = velocity;
  }
  /// Lets time pass without a cycle.
  void pause(std::int64_t ns) noexcept { now_ += ns; }
  /// Second half of `step`, the work of the haptic thread: refines, and then computes the forces.
  const hrtc_service::CycleResult& run_cycle(std::uint32_t units) noexcept {
    core_.servo().refine(spm::Budget{units});
    return touch();
  }
  /// Computes the forces of the cycle only. Bodies are not simulated, so movable objects do not move.
  const hrtc_service::CycleResult& touch() noexcept {
    hrtc_service::ServoLink& link = core_.link();
    std::array<hrtc_service::Arrival, 64> arrived;
    const auto count = static_cast<std::uint32_t>(core_.intake().arrivals().pop(arrived.data(), arrived.size()));
    (void)hrtc_service::MailboxReader{link.near_objects}.take(near_);
    for (std::size_t i = 0; i < inputs_.size(); ++i) inputs_[i].near = near_[i];
    const hrtc_service::CycleResult& result = cycle().touch(inputs_, now_, arrived.data(), count);
    hrtc_service::MailboxWriter{link.reports}.post(
        {now_, now_ + kPeriodNs, cycles_, result.probes, result.interventions});
    return result;
  }
  /// Computes all forces of the servo, including those of bodies.
  const hrtc_service::Servo::Outputs& touch_with_bodies() noexcept {
    core_.servo().touch(inputs_, now_);
    core_.servo().publish(now_, now_ + kPeriodNs);
    return core_.servo().outputs();
  }

  /// Pops the next entry of the contact log; false if there is none.
  bool take_log(trace::LoggedQuery& entry) { return queries_.pop(entry); }

  /// Inputs of the next `touch`. `prepare` sets the input of the first probe; a test may set the others.
  [[nodiscard]] std::array<hrtc_service::ProbeInput, hrtc_service::kMaxProbes>& inputs() { return inputs_; }
  [[nodiscard]] std::int64_t now_ns() const noexcept { return now_; }
  [[nodiscard]] const session::CatalogueEntry& entry(std::size_t object) const { return host_.catalogue()[object]; }
  [[nodiscard]] hrtc_service::HrtcCore& core() noexcept { return core_; }
  [[nodiscard]] hrtc_service::Membership& membership() noexcept { return *membership_; }
  [[nodiscard]] hrtc_service::Gateway& gateway() noexcept { return core_.gateway(); }
  [[nodiscard]] hrtc_service::Cycle& cycle() noexcept { return core_.servo().cycle(); }
  [[nodiscard]] const hrtc_service::Loader& loader() const noexcept { return core_.gateway().loader(); }
  static hrtc_service::CycleSettings cycle_settings(const spm::MeshProbe* tool = nullptr,
                                                    std::uint32_t targets = hrtc_service::CycleSettings{}.targets) {
    hrtc_service::CycleSettings settings;
    settings.force.soft_start = 0.01;
    settings.tool = tool;
    settings.targets = targets;
    return settings;
  }
  static hrtc_service::HrtcCoreSettings core_settings(const spm::PoolSettings& pool,
                                                      const hrtc_service::LoaderSettings& loader,
                                                      std::uint32_t targets = hrtc_service::CycleSettings{}.targets) {
    hrtc_service::HrtcCoreSettings settings;
    settings.pool = pool;
    settings.servo.cycle = cycle_settings(loader.tool, targets);
    settings.servo.specs = specs();
    settings.gateway.loader = loader;
    settings.logs_queries = true;
    return settings;
  }
  static std::array<haptics::DeviceSpec, hrtc_service::kMaxProbes> specs() {
    std::array<haptics::DeviceSpec, hrtc_service::kMaxProbes> specs;
    for (haptics::DeviceSpec& spec : specs) spec.max_torque = 1;
    return specs;
  }

  /// Settings of a host whose objects are 1 m apart along x. If `mass` is above 0, the last object is movable.
  static host_service::HostCoreSettings host_settings(const std::vector<spm::codec::EncodedModel>& models, double scale,
                                                      const session::Material& material, double mass) {
    host_service::HostCoreSettings settings;
    settings.name = "host";
    for (std::size_t i = 0; i < models.size(); ++i) {
      host_service::ObjectConfig object;
      object.name = "object" + std::to_string(i);
      object.pose.emplace().position = {static_cast<double>(i), 0, 0};
      object.scale = scale;
      object.material = material;
      if (mass > 0 && i + 1 == models.size()) object.body = {mass, {}, 0.5, -1};
      settings.objects.push_back({object, &models[i].compressed()});
    }
    return settings;
  }

  std::vector<std::string> events;  ///< log lines of the gateway
  bool connected = true;            ///< false: new samples between host and HRTC are lost
  bool has_gateway = true;          ///< false: the gateway does nothing

 private:
  template <class Sample>
  struct Delayed {
    std::uint64_t due_cycle;
    Sample sample;
  };

  [[nodiscard]] session::Origin hrtc_origin() const { return {kSession, kHrtc, incarnation_, 0}; }
  void join() {
    membership_.emplace(hrtc_origin(), hrtc_service::MembershipSettings{"hrtc", "session"}, core_.gateway(), now_);
    gateway().on_event = [this](session::Severity, const std::string& text) { events.push_back(text); };
    if (!connected) return;
    study::exchange_membership(host_, *membership_, now_);
    // DDS repeats the catalogue for a late reader.
    for (const session::CatalogueEntry& entry : host_.catalogue()) membership_->on_catalogue(entry);
  }

  void exchange() {
    core_.tick_intake();
    gateway().tick(now_, membership_->clock());
    membership_->tick(now_);
    if (connected) study::exchange_membership(host_, *membership_, now_);
    while (auto demand = gateway().demand(now_))
      if (connected) demands_.push_back({cycles_ + delay_, std::move(*demand)});
    while (!demands_.empty() && demands_.front().due_cycle <= cycles_) {
      host_.on_demand(demands_.front().sample, now_);
      demands_.pop_front();
    }
    while (auto chunk = host_.next_chunk(now_))
      if (connected) chunks_.push_back({cycles_ + delay_, std::move(chunk->chunk)});
    while (!chunks_.empty() && chunks_.front().due_cycle <= cycles_) {
      gateway().on_chunk(chunks_.front().sample, now_);
      chunks_.pop_front();
    }
    core_.tick_intake();
  }

  std::vector<spm::Model> models_;
  std::vector<spm::codec::EncodedModel> encoded_;
  std::int64_t now_ = 1'000'000'000;
  std::uint64_t incarnation_ = 1;  // of the HRTC
  host_service::HostCore host_;
  hrtc_service::HrtcCore core_;
  std::optional<hrtc_service::Membership> membership_;
  std::uint32_t delay_;
  std::uint64_t cycles_ = 0;
  std::array<hrtc_service::ProbeInput, hrtc_service::kMaxProbes> inputs_;
  std::array<hrtc_service::NearObjects, hrtc_service::kMaxProbes> near_{};
  hrtc_service::RingReader<trace::LoggedQuery, hrtc_service::ContactQuery::kLogEntries> queries_{core_.log()};
  std::deque<Delayed<session::Demand>> demands_;
  std::deque<Delayed<session::BulkChunk>> chunks_;
};

}  // namespace tactus::test_support
