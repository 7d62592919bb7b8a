/// Assembles an HRTC from gateway, intake and servo, without DDS, threads, devices and files.
///
///     samples, times --> Gateway <== ServoLink ==> Intake, BodyIntake --> Servo <-- probe inputs, limit of refinement
///                          |             ^============================>     |
///              demands, claims, events                                    forces
///
/// Studies, benchmarks and tests assemble an HRTC here, and call all of it in one thread. In a service, the servo has
/// threads of its own (servo/servo_runner.hpp).
#pragma once

#include <memory>
#include <optional>

#include "hrtc_service/gateway.hpp"
#include "hrtc_service/servo/body_intake.hpp"
#include "hrtc_service/servo/intake.hpp"
#include "hrtc_service/servo/servo.hpp"
#include "hrtc_service/servo/servo_link.hpp"

namespace tactus::hrtc_service {

struct HrtcCoreSettings {
  spm::PoolSettings pool;
  ServoSettings servo;
  GatewaySettings gateway;    ///< radius and tool of the loader are taken from the cycle
  bool logs_queries = false;  ///< the ring of HrtcCore::log exists
};

/// Returns the gateway's settings with those that it must share with the servo.
[[nodiscard]] inline GatewaySettings gateway_settings(const HrtcCoreSettings& settings) {
  GatewaySettings gateway = settings.gateway;
  gateway.loader.radius = settings.servo.cycle.radius;
  gateway.loader.tool = settings.servo.cycle.tool;
  return gateway;
}

class HrtcCore {
 public:
  /// Allocates pool, tree nodes, rings and servo. Throws std::bad_alloc if that fails.
  HrtcCore(const session::Origin& self, const HrtcCoreSettings& settings)
      : link_{std::make_unique<ServoLink>()},
        log_{settings.logs_queries ? std::make_unique<ContactQuery::LogRing>() : nullptr},
        intake_{settings.pool, link_->intake, settings.gateway.loader.directory_bytes},
        body_intake_{intake_.objects(), link_->bodies},
        servo_{settings.servo, *link_, intake_, body_intake_.orders(), log_.get()},
        pool_{settings.pool},
        gateway_settings_{gateway_settings(settings)} {
    replace_gateway(self);
  }
  HrtcCore(const HrtcCore&) = delete;
  HrtcCore& operator=(const HrtcCore&) = delete;

  /// Replaces the gateway by a new one without callbacks, as after its end. The servo keeps all it has.
  void replace_gateway(const session::Origin& self) {
    gateway_.reset();
    gateway_.emplace(pool_, self, gateway_settings_, *link_);
  }

  [[nodiscard]] Servo& servo() noexcept { return servo_; }
  [[nodiscard]] const Servo& servo() const noexcept { return servo_; }
  [[nodiscard]] Gateway& gateway() noexcept { return *gateway_; }
  [[nodiscard]] const Gateway& gateway() const noexcept { return *gateway_; }
  /// Passes to the servo what the gateway has sent. Call it after each tick of the gateway and after received samples.
  void tick_intake() {
    intake_.tick();
    // A base mesh is larger than the ring. The limit ends the loop if the intake waits for the haptic thread.
    for (int left = 256; left > 0 && !gateway_->send_waiting(); --left) intake_.tick();
    tick_servo();
  }
  /// Passes to the servo what is in the link.
  void tick_servo() {
    intake_.tick();
    body_intake_.tick();
  }
  [[nodiscard]] Intake& intake() noexcept { return intake_; }
  [[nodiscard]] const Intake& intake() const noexcept { return intake_; }
  [[nodiscard]] ServoLink& link() noexcept { return *link_; }
  /// Returns the ring of logged queries. Requires HrtcCoreSettings::logs_queries.
  [[nodiscard]] ContactQuery::LogRing& log() noexcept { return *log_; }
  [[nodiscard]] const spm::Pool& pool() const noexcept { return intake_.objects().pool(); }
  [[nodiscard]] const spm::NodePool& nodes() const noexcept { return intake_.objects().nodes(); }

 private:
  std::unique_ptr<ServoLink> link_;
  std::unique_ptr<ContactQuery::LogRing> log_;  // null: the servo logs no queries
  Intake intake_;
  BodyIntake body_intake_;
  Servo servo_;
  spm::PoolSettings pool_;
  GatewaySettings gateway_settings_;
  std::optional<Gateway> gateway_;
};

}  // namespace tactus::hrtc_service
