/// Receives the gateway's orders for movable objects, checks them, and makes the couplings to the copies of peers.
///
///     BodyLink::granted --> [check, make couplings] --> BodyOrderLink::orders --> haptic thread (Bodies)
///                           [free]                  <-- BodyOrderLink::seen   <-'
///
/// A coupling takes about 0.5 MB. It exists until the haptic thread has received orders for its object that do not name
/// it, or has returned the object. A body with kMaxCouplings of them gets no other one until one is freed.
/// Trusts nothing in the link: for an object with wrong numbers, the last orders remain. If an object is there twice,
/// the first order counts.
///
/// One thread, the one of the intake. Allocates.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>

#include "hrtc_service/servo/bodies.hpp"
#include "hrtc_service/servo/touch_objects.hpp"

namespace tactus::hrtc_service {

class BodyIntake {
 public:
  static constexpr std::size_t kMaxCouplings = 4;  ///< of a body

  /// The arguments must outlive this object.
  BodyIntake(const TouchObjects& objects, BodyLink& link) : objects_{objects}, granted_in_{link.granted} {}

  /// Processes the newest orders of the gateway, and frees couplings. Call it every few milliseconds, and soon after the
  /// gateway has posted orders.
  void tick();

  [[nodiscard]] BodyOrderLink& orders() noexcept { return order_link_; }
  /// Returns the number of couplings that exist.
  [[nodiscard]] std::size_t couplings() const noexcept;

 private:
  struct Coupling {
    GrantedCoupling granted;
    std::unique_ptr<haptics::CopyCoupling> coupling;
    std::uint64_t first_orders_without = 0;  // number of the first orders that do not name it; 0: in use
  };
  struct Body {
    std::uint64_t serial = 0;  // of the object, in TouchObjects
    BodyOrder order;
    std::deque<Coupling> couplings;  // only the last one may be in use
  };
  void apply(const GrantedBody& granted);
  void set_coupling(Body& body, const GrantedCoupling& granted, const haptics::BodySettings& settings);
  void post();
  void free_unused();

  const TouchObjects& objects_;
  MailboxReader<GrantedBodies> granted_in_;
  BodyOrderLink order_link_;
  GrantedBodies granted_;
  std::uint64_t posted_ = 0;              // number of the newest orders
  std::array<Body, kMaxObjects> bodies_;  // by object index
};

}  // namespace tactus::hrtc_service
