/// A host, a loader and a cycle in one thread, without DDS: a session in which every step can be looked at.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "hrtc_service/cycle.hpp"
#include "hrtc_service/loader.hpp"
#include "session/delivery_server.hpp"
#include "spm/codec/model_codec.hpp"

namespace tactus::test_support {

class LocalSession {
 public:
  static constexpr std::uint64_t kHost = 10, kHrtc = 20, kSession = 30;
  static constexpr std::int64_t kPeriodNs = 1'000'000;

  /// `models` must outlive the session; scale in metres per file unit. `delay_cycles`: chunks and demands are that long
  /// under way. A tool of the loader's is the cycle's, too. With a `mass`, kg, the last object can move.
  LocalSession(const std::vector<spm::Model>& models, double scale, spm::PoolSettings settings,
               std::uint32_t delay_cycles = 2, const hrtc_service::LoaderSettings& loader = {},
               const session::Material& material = {}, double mass = 0,
               std::uint32_t targets = hrtc_service::CycleSettings{}.targets)
      : models_{models},
        pool_{settings},
        nodes_{settings.tree_nodes},
        server_{session::Origin{kSession, kHost, 1, 0}},
        loader_{pool_, nodes_, session::Origin{kSession, kHrtc, 1, 0}, loader, arrivals_, departures_},
        cycle_{cycle_settings(loader.tool, targets), specs(), departures_, &log_},
        delay_{delay_cycles} {
    loader_.on_event = [this](const std::string& text) { events.push_back(text); };
    for (std::size_t i = 0; i < models_.size(); ++i) {
      const std::uint64_t id = 100 + i;
      encoded_.emplace_back(models_[i]);
      server_.add(id, encoded_.back().coded());
      session::CatalogueEntry entry;
      entry.origin = {kSession, kHost, 1, 0};
      entry.host = "host";
      entry.object = "object" + std::to_string(i);
      entry.object_id = id;
      entry.summary = models_[i].summary;
      entry.scale = scale;
      entry.material = material;
      if (mass > 0 && i + 1 == models_.size())
        entry.body = {mass, sharing::inertia_of_bounds(entry.summary, scale, mass), 0.5, -1};
      entry.pose.position = {static_cast<double>(i), 0, 0};
      entry.base_bytes = server_.base_bytes(id);
      loader_.on_host_seen(kHost, 1, now_);
      loader_.on_catalogue(entry);
      entries_.push_back(entry);
    }
  }

  /// One cycle with one tip at `device` (world). Host and loader work every second cycle.
  const hrtc_service::CycleResult& step(const spm::Vec3d& device, const spm::Vec3d& velocity,
                                        std::uint32_t units = 1u << 20) {
    prepare(device, velocity);
    return run_cycle(units);
  }
  /// The first half: all but what the haptic thread does.
  void prepare(const spm::Vec3d& device, const spm::Vec3d& velocity) {
    now_ += kPeriodNs;
    ++cycles_;
    if (cycles_ % 2 == 0) exchange(device);
    inputs_[0].active = true;
    inputs_[0].device.position = device;
    inputs_[0].device.velocity = velocity;
    inputs_[0].near = near_[0];
  }
  /// The second half: the haptic thread's, from one look at the mesh that was touched to the next.
  const hrtc_service::CycleResult& run_cycle(std::uint32_t units) noexcept {
    cycle_.refine(spm::Budget{units});
    return touch();
  }
  const hrtc_service::CycleResult& touch() noexcept {
    std::array<hrtc_service::Arrival, 64> arrived;
    const auto count = static_cast<std::uint32_t>(arrivals_.pop(arrived.data(), arrived.size()));
    const hrtc_service::CycleResult& result = cycle_.touch(inputs_, now_, arrived.data(), count);
    in_contact_ = (result.probes[0].status & session::kInContact) != 0;
    proxy_ = hrtc_service::vec(result.probes[0].proxy);
    orientation_ = hrtc_service::quaternion(result.probes[0].orientation);
    return result;
  }

  /// The next log entry; false when there is none.
  bool take_log(trace::LoggedQuery& entry) { return log_.pop(entry); }

  /// What the next `touch` is given: that of the first probe is set by `prepare`, others are whose test it is.
  [[nodiscard]] std::array<hrtc_service::ProbeInput, hrtc_service::kMaxProbes>& inputs() { return inputs_; }
  [[nodiscard]] const session::CatalogueEntry& entry(std::size_t object) const { return entries_[object]; }
  [[nodiscard]] hrtc_service::Cycle& cycle() { return cycle_; }
  [[nodiscard]] hrtc_service::Loader& loader() { return loader_; }
  [[nodiscard]] session::DeliveryServer& server() { return server_; }
  static hrtc_service::CycleSettings cycle_settings(const spm::MeshProbe* tool = nullptr,
                                                    std::uint32_t targets = hrtc_service::CycleSettings{}.targets) {
    hrtc_service::CycleSettings settings;
    settings.force.soft_start = 0.01;
    settings.tool = tool;
    settings.targets = targets;
    return settings;
  }
  static std::array<haptics::DeviceSpec, hrtc_service::kMaxProbes> specs() {
    std::array<haptics::DeviceSpec, hrtc_service::kMaxProbes> specs;
    for (haptics::DeviceSpec& spec : specs) spec.max_torque = 1;
    return specs;
  }

  /// What the loader said.
  std::vector<std::string> events;
  /// While false nothing passes between host and loader.
  bool connected = true;

 private:
  template <class Sample>
  struct Delayed {
    std::uint64_t due;
    Sample sample;
  };

  void exchange(const spm::Vec3d& device) {
    std::array<hrtc_service::ProbeSight, hrtc_service::kMaxProbes> sights;
    sights[0] = {true, in_contact_, now_, device, proxy_, orientation_};
    loader_.on_host_seen(kHost, 1, now_);
    loader_.tick(now_, sights, near_);
    while (auto demand = loader_.demand(now_))
      if (connected) demands_.push_back({cycles_ + delay_, std::move(*demand)});
    while (!demands_.empty() && demands_.front().due <= cycles_) {
      server_.on_demand(demands_.front().sample, now_);
      demands_.pop_front();
    }
    while (auto chunk = server_.next(now_))
      if (connected) chunks_.push_back({cycles_ + delay_, std::move(chunk->chunk)});
    while (!chunks_.empty() && chunks_.front().due <= cycles_) {
      loader_.on_chunk(chunks_.front().sample, now_);
      chunks_.pop_front();
    }
  }

  std::vector<spm::Model> models_;
  spm::Pool pool_;
  spm::NodePool nodes_;
  hrtc_service::ArrivalRing arrivals_{4096};
  hrtc_service::DepartureRing departures_{4096};
  hrtc_service::Cycle::LogRing log_{256};
  std::vector<spm::codec::EncodedModel> encoded_;
  std::vector<session::CatalogueEntry> entries_;
  session::DeliveryServer server_;
  hrtc_service::Loader loader_;
  hrtc_service::Cycle cycle_;
  std::uint32_t delay_;
  std::int64_t now_ = 1'000'000'000;
  std::uint64_t cycles_ = 0;
  bool in_contact_ = false;
  spm::Vec3d proxy_ = spm::Vec3d::Zero();
  Eigen::Quaterniond orientation_ = Eigen::Quaterniond::Identity();
  std::array<hrtc_service::ProbeInput, hrtc_service::kMaxProbes> inputs_;
  std::array<hrtc_service::NearObjects, hrtc_service::kMaxProbes> near_;
  std::deque<Delayed<session::Demand>> demands_;
  std::deque<Delayed<session::BulkChunk>> chunks_;
};

}  // namespace tactus::test_support
