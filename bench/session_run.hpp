/// Runs the cores of a host and of an HRTC with one object, in one thread and without DDS, for benchmarks of a whole
/// HRTC.
///
/// The host sends regions through the delivery protocol and the codec. Demands and chunks arrive after `delay_cycles`.
/// The object is at the origin, so that metres in the world are file units times `scale`.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

#include "bench/priority.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/model.hpp"

namespace tactus::bench {

struct SessionSettings {
  spm::PoolSettings pool;
  hrtc_service::LoaderSettings loader;
  hrtc_service::CycleSettings cycle;
  haptics::DeviceSpec device;
  session::Material material;
  std::uint32_t delay_cycles = 2;
};

/// One region that the loader received.
struct RegionLoad {
  std::uint64_t records = 0;  ///< number of records received
  double us = 0;              ///< CPU time from the arrival of its last chunk until its records have slots
};

class SessionRun {
 public:
  static constexpr std::int64_t kPeriodNs = 1'000'000;

  /// Begins with an empty pool, which has not even the base mesh. `model` must outlive this object.
  SessionRun(const spm::Model& model, double scale, const SessionSettings& settings);
  SessionRun(const SessionRun&) = delete;
  SessionRun& operator=(const SessionRun&) = delete;

  /// Runs cycles with the tip at `away`, far from the object, until the base mesh is shown. Throws std::runtime_error
  /// if that takes more than 20,000 cycles.
  void settle(const spm::Vec3d& away);

  /// Begins a cycle: runs everything outside the haptic thread. Host and loader run in every second cycle.
  void prepare(const spm::Vec3d& tip, const spm::Vec3d& velocity,
               const Eigen::Quaterniond& orientation = Eigen::Quaterniond::Identity());
  /// Adds a second probe to the prepared cycle.
  void prepare_second(const spm::Vec3d& tip, const spm::Vec3d& velocity);
  /// Runs the haptic thread's part of the prepared cycle, with refinement before contact.
  const hrtc_service::CycleResult& cycle(spm::Budget budget) noexcept;
  /// Runs the haptic thread's part of the prepared cycle in the order of an HRTC: contact, then refinement up to
  /// `limit`.
  const hrtc_service::CycleResult& cycle(const hrtc_service::RefineLimit& limit) noexcept;

  [[nodiscard]] const hrtc_service::Loader& loader() const noexcept { return core_.gateway().loader(); }
  [[nodiscard]] hrtc_service::Cycle& haptic() noexcept { return core_.servo().cycle(); }
  /// Returns the CPU time of the gateway in the last `prepare`, us.
  [[nodiscard]] double gateway_us() const noexcept { return loader_us_; }
  /// Returns the regions that the loader received in the last `prepare`.
  [[nodiscard]] const std::vector<RegionLoad>& loads() const noexcept { return loads_; }

 private:
  template <class Sample>
  struct Delayed {
    std::uint64_t due;
    Sample sample;
  };
  void touch() noexcept;
  void exchange();

  std::uint32_t delay_;
  spm::codec::EncodedModel encoded_;
  std::int64_t now_ = 1'000'000'000;
  host_service::HostCore host_;
  hrtc_service::HrtcCore core_;
  hrtc_service::Membership membership_;
  hrtc_service::Servo::Inputs inputs_;
  std::deque<Delayed<session::Demand>> demands_;
  std::deque<Delayed<session::BulkChunk>> chunks_;
  std::uint64_t cycles_ = 0;
  double loader_us_ = 0;
  std::vector<RegionLoad> loads_;
};

}  // namespace tactus::bench
