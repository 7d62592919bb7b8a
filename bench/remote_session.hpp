/// The cores of a host and an HRTC joined by a link of known rate and delay, in virtual time: nothing sleeps, and the
/// same settings give the same run to the last bit.
///
/// The cores are those that the programs run; only threads, sockets and clocks are missing. One object, one probe. The
/// cycle comes every millisecond, the loader's tick every second one, as in tactus-hrtc; the network moves four times a
/// millisecond. World frame, metres.
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
  double round_trip = 0;           ///< s, half each way
  std::uint32_t budget = 1 << 14;  ///< of a cycle, units of spm::Budget
  hrtc_service::LoaderSettings loader;
};

class RemoteSession {
 public:
  /// `model` must outlive the session; its metres_per_unit is the object's scale.
  RemoteSession(const spm::Model& model, const RemoteSettings& settings);
  RemoteSession(const RemoteSession&) = delete;
  RemoteSession& operator=(const RemoteSession&) = delete;

  /// Runs until the base mesh is shown, without a probe. Throws std::runtime_error when that takes over a minute.
  void start();
  /// One millisecond with the tip at `tip`.
  const hrtc_service::ProbeOutput& step(const spm::Vec3d& tip);

  [[nodiscard]] const spm::Forest& forest() const { return *core_.servo().cycle().objects().front()->forest; }
  [[nodiscard]] const hrtc_service::Loader& loader() const noexcept { return core_.gateway().loader(); }
  [[nodiscard]] spm::Vec3d to_model(const spm::Vec3d& world) const noexcept { return world / scale_; }
  [[nodiscard]] double scale() const noexcept { return scale_; }

  /// Payload of regions since the probe came.
  struct Traffic {
    std::uint64_t bytes = 0;
    std::uint64_t unused = 0;  ///< of regions that went, or are here still, and were never met by the tip
    std::uint64_t regions = 0;
  };
  [[nodiscard]] Traffic traffic() const;
  /// Cycles whose refinement ended at its budget, and those that found no tree node.
  [[nodiscard]] std::uint64_t budget_spent() const noexcept { return budget_spent_; }
  [[nodiscard]] std::uint64_t nodes_full() const noexcept { return nodes_full_; }

 private:
  struct Chunk {
    std::int64_t due;
    session::BulkChunk chunk;
  };
  struct Question {
    std::int64_t due;
    session::Demand demand;
  };
  static constexpr std::uint64_t kHost = 10, kHrtc = 20, kSession = 30;

  void network(std::int64_t until);
  const hrtc_service::ProbeOutput& run_cycle();

  RemoteSettings settings_;
  double scale_;
  spm::codec::EncodedModel encoded_;
  std::int64_t now_ = 1'000'000'000;
  host_service::HostCore host_;
  hrtc_service::HrtcCore core_;
  hrtc_service::Membership membership_;
  std::deque<Chunk> chunks_;
  std::deque<Question> questions_;
  std::int64_t link_free_ = 0;
  std::uint64_t cycles_ = 0;
  spm::Vec3d last_tip_ = spm::Vec3d::Zero();
  hrtc_service::Servo::Inputs inputs_;
  std::vector<std::uint64_t> unmet_;  // bytes, by region
  Traffic traffic_;
  std::uint64_t budget_spent_ = 0, nodes_full_ = 0;
};

}  // namespace tactus::bench
