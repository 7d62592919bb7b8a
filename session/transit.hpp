/// The transit of nearly all samples: the max of the last two seconds, without their worst tenth of a second, because a
/// single stall is not worth waiting for.
///
/// When session time steps back, because the session has joined an older one, later measurements are dropped.
/// One thread at a time. Does not allocate.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace tactus::session {

class TransitEstimator {
 public:
  void on_transit(std::int64_t transit_ns, std::int64_t now_ns) noexcept;
  /// As of the last sample; 0 when there was none.
  [[nodiscard]] std::int64_t max_ns() const noexcept { return max_ns_; }

 private:
  static constexpr std::size_t kTenths = 20;
  static constexpr std::int64_t kTenthNs = 100'000'000;
  struct Tenth {
    std::int64_t number = -1;
    std::int64_t transit_ns = 0;
  };
  std::array<Tenth, kTenths> tenths_;  // the max transit in each
  std::int64_t max_ns_ = 0;
};

}  // namespace tactus::session
