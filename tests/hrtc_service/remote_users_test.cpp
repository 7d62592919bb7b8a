#include "hrtc_service/remote_users.hpp"

#include <gtest/gtest.h>

#include "tests/support/constants.hpp"

namespace tactus::hrtc_service {
namespace {

TEST(RemoteUsers, ReturnsALossReportUntilItExpires) {
  RemoteUsers users{0x11};
  session::Metrics metrics;
  metrics.origin.participant = 0x22;
  metrics.figures = {{session::figures::kLostOf + std::string{"0000000000000011"}, 0.25}};
  users.on_metrics(metrics, 0);
  users.tick(3000 * kMs);
  EXPECT_EQ(users.loss(), 0.25);
  users.tick(3001 * kMs);
  EXPECT_EQ(users.loss(), 0);
}

}  // namespace
}  // namespace tactus::hrtc_service
