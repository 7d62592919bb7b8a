/// Assembles an HRTC from memory, servo and gateway, without DDS, threads, devices and files.
///
///     samples, times --> Gateway <== ServoLink ==> Servo <-- probe inputs, limit of refinement
///                          |                         |
///              demands, claims, events             forces
///
/// Services, studies, benchmarks and tests all assemble an HRTC here.
#pragma once

#include "hrtc_service/gateway.hpp"
#include "hrtc_service/servo.hpp"
#include "hrtc_service/servo_link.hpp"
#include "spm/pool.hpp"

namespace tactus::hrtc_service {

struct HrtcCoreSettings {
  spm::PoolSettings pool;
  ServoSettings servo;
  GatewaySettings gateway;  ///< radius and tool of the loader are taken from the cycle
  bool logs_queries = false;
  const std::atomic<std::uint32_t>* emergency_stop_signals =
      nullptr;  ///< number of local stops by a signal; null: none
};

class HrtcCore {
 public:
  /// Allocates pool, tree nodes, rings and servo. Throws std::bad_alloc if that fails.
  HrtcCore(const session::Origin& self, const HrtcCoreSettings& settings)
      : pool_{settings.pool},
        nodes_{settings.pool.tree_nodes},
        link_{settings.logs_queries, settings.emergency_stop_signals},
        servo_{settings.servo, link_},
        gateway_{pool_, nodes_, self, gateway_settings(settings), link_} {}
  HrtcCore(const HrtcCore&) = delete;
  HrtcCore& operator=(const HrtcCore&) = delete;

  [[nodiscard]] Servo& servo() noexcept { return servo_; }
  [[nodiscard]] const Servo& servo() const noexcept { return servo_; }
  [[nodiscard]] Gateway& gateway() noexcept { return gateway_; }
  [[nodiscard]] const Gateway& gateway() const noexcept { return gateway_; }
  [[nodiscard]] ServoLink& link() noexcept { return link_; }
  [[nodiscard]] const spm::Pool& pool() const noexcept { return pool_; }
  [[nodiscard]] const spm::NodePool& nodes() const noexcept { return nodes_; }

 private:
  [[nodiscard]] static GatewaySettings gateway_settings(const HrtcCoreSettings& settings) {
    GatewaySettings gateway = settings.gateway;
    gateway.loader.radius = settings.servo.cycle.radius;
    gateway.loader.tool = settings.servo.cycle.tool;
    return gateway;
  }

  spm::Pool pool_;
  spm::NodePool nodes_;
  ServoLink link_;
  Servo servo_;
  Gateway gateway_;
};

}  // namespace tactus::hrtc_service
