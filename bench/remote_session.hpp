/// Runs the cores of a host and of an HRTC in virtual time, connected by a link of known rate and delay. The same
/// settings give the same run, to the bit.
///
/// The programs tactus-host and tactus-hrtc run the same cores, but with threads, sockets and clocks. There are one
/// object and one probe. A cycle takes 1 ms. The loader ticks in every second cycle, as in tactus-hrtc. The link
/// advances by steps of 0.25 ms. World frame, metres.
///
///     tip -> [Cycle] <- regions <- [Loader] <- chunks <- link: rate, then delay <- [HostCore]
///                                      |---- demands ---> delay ------------------>|
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

#include "host_service/host_core.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "spm/codec/model_codec.hpp"

namespace tactus::bench {

struct RemoteSettings {
  spm::PoolSettings pool;
  double radius = 0.003;           ///< m, of the tip
  double rate = 100e6;             ///< bit/s from host to HRTC
  double round_trip = 0;           ///< s, half in each direction
  std::uint32_t budget = 1 << 14;  ///< of a cycle, units of spm::Budget
  hrtc_service::LoaderSettings loader;
};

class RemoteSession {
 public:
  /// `model` must outlive the session; its metres_per_unit is the object's scale.
  RemoteSession(const spm::Model& model, const RemoteSettings& settings);
  RemoteSession(const RemoteSession&) = delete;
  RemoteSession& operator=(const RemoteSession&) = delete;

  /// Runs without a probe until the base mesh is shown. Throws std::runtime_error if that takes more than a minute.
  void start();
  /// Runs one cycle with the tip at `tip`.
  const hrtc_service::ProbeOutput& step(const spm::Vec3d& tip);

  [[nodiscard]] const spm::Forest& forest() const { return *core_.servo().cycle().objects().front()->forest; }
  [[nodiscard]] const hrtc_service::Loader& loader() const noexcept { return core_.gateway().loader(); }
  [[nodiscard]] spm::Vec3d to_model(const spm::Vec3d& world) const noexcept { return world / scale_; }
  [[nodiscard]] double scale() const noexcept { return scale_; }

  /// Regions received since construction.
  struct Traffic {
    std::uint64_t bytes = 0;         ///< payload
    std::uint64_t unused_bytes = 0;  ///< payload of each arrival of a region that the tip did not touch afterwards
    std::uint64_t regions = 0;       ///< number of arrivals
  };
  [[nodiscard]] Traffic traffic() const;
  /// Returns the number of cycles whose refinement ended at its budget.
  [[nodiscard]] std::uint64_t budget_spent() const noexcept { return budget_spent_; }
  /// Returns the number of cycles whose refinement found no free tree node.
  [[nodiscard]] std::uint64_t nodes_full() const noexcept { return nodes_full_; }

 private:
  struct ChunkInTransit {
    std::int64_t due_ns;
    session::BulkChunk chunk;
  };
  struct DemandInTransit {
    std::int64_t due_ns;
    session::Demand demand;
  };
  static constexpr std::uint64_t kHost = 10, kHrtc = 20, kSession = 30;

  void run_link(std::int64_t until_ns);
  const hrtc_service::ProbeOutput& run_cycle();

  RemoteSettings settings_;
  double scale_;
  spm::codec::EncodedModel encoded_;
  std::int64_t now_ns_ = 1'000'000'000;
  host_service::HostCore host_;
  hrtc_service::HrtcCore core_;
  hrtc_service::Membership membership_;
  std::deque<ChunkInTransit> chunks_;
  std::deque<DemandInTransit> demands_;
  std::int64_t link_free_ns_ = 0;
  std::uint64_t cycles_ = 0;
  spm::Vec3d last_tip_ = spm::Vec3d::Zero();
  hrtc_service::Servo::Inputs inputs_;
  std::vector<std::uint64_t> untouched_bytes_;  // by region; 0 once the tip has touched the region
  Traffic traffic_;
  std::uint64_t budget_spent_ = 0, nodes_full_ = 0;
};

}  // namespace tactus::bench
