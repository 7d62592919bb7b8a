/// The cores of a host and an HRTC around one model, in one thread and without DDS: what benchmarks of a whole HRTC
/// drive.
///
/// The host serves through the delivery protocol and the codec; demands and chunks are `delay_cycles` under way. The
/// object stands at the origin, so world metres are file units times `scale`.
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

/// One region as the loader took it in.
struct RegionLoad {
  std::uint64_t records = 0;  ///< received
  double us = 0;              ///< of CPU time, from its last chunk to its slots
};

class SessionRun {
 public:
  static constexpr std::int64_t kPeriodNs = 1'000'000;

  /// `model` must outlive it. Nothing is here yet, the base mesh included.
  SessionRun(const spm::Model& model, double scale, const SessionSettings& settings);
  SessionRun(const SessionRun&) = delete;
  SessionRun& operator=(const SessionRun&) = delete;

  /// Cycles far from the object until its base mesh is shown. Throws std::runtime_error when it does not come.
  void settle(const spm::Vec3d& away);

  /// All but the haptic thread's part: host and loader work in every second cycle.
  void prepare(const spm::Vec3d& tip, const spm::Vec3d& velocity,
               const Eigen::Quaterniond& orientation = Eigen::Quaterniond::Identity());
  /// Gives the cycle that was prepared a second probe.
  void prepare_second(const spm::Vec3d& tip, const spm::Vec3d& velocity);
  /// The haptic thread's part of the cycle that was prepared.
  const hrtc_service::CycleResult& cycle(spm::Budget budget) noexcept;
  /// The same as a haptic thread has it: touch, then refine as long as that is allowed.
  const hrtc_service::CycleResult& cycle(const hrtc_service::RefineLimit& limit) noexcept;

  [[nodiscard]] const hrtc_service::Loader& loader() const noexcept { return core_.gateway().loader(); }
  [[nodiscard]] hrtc_service::Cycle& haptic() noexcept { return core_.servo().cycle(); }
  /// CPU time of the gateway in the last `prepare`, us.
  [[nodiscard]] double loader_us() const noexcept { return loader_us_; }
  /// Regions taken in during the last `prepare`.
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
