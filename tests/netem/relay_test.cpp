#include "netem/relay.hpp"

#include <gmock/gmock.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <thread>

namespace tactus::netem {
namespace {

/// A relay between two pairs of sockets. Like TAP devices, they preserve frame boundaries, but they need no privileges.
class RelayTest : public testing::Test {
 protected:
  RelayTest() {
    for (auto& pair : sockets_) {
      if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK, 0, pair.data()) != 0)
        throw std::runtime_error{"sockets"};
      const int buffer_bytes = 4 << 20;
      for (const int socket : pair) ::setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &buffer_bytes, sizeof buffer_bytes);
    }
  }
  ~RelayTest() override {
    stop();
    for (auto& pair : sockets_)
      for (const int socket : pair) ::close(socket);
  }

  void start(const LinkProfile& profile, std::uint64_t seed = 7) {
    relay_ = std::make_unique<Relay>(sockets_[0][1], sockets_[1][1],
                                     LinkSettings{"", Medium::kRelay, profile, profile, seed});
    thread_ = std::thread{[this] { relay_->run(); }};
  }
  void stop() {
    if (!thread_.joinable()) return;
    relay_->stop();
    thread_.join();
  }
  void send(int side, std::uint32_t number) {
    std::array<std::uint32_t, 64> frame{};
    frame[0] = number;
    frame[63] = ~number;
    ASSERT_EQ(::write(sockets_[side][0], frame.data(), sizeof frame), static_cast<ssize_t>(sizeof frame));
  }
  /// Returns the number of the next frame, which must be complete, or nothing if no frame arrives within `limit_ms`.
  std::optional<std::uint32_t> next(int side, int limit_ms = 20'000) {
    pollfd poll_entry{sockets_[side][0], POLLIN, 0};
    if (::poll(&poll_entry, 1, limit_ms) != 1) return std::nullopt;
    std::array<std::uint32_t, 64> frame{};
    EXPECT_EQ(::read(sockets_[side][0], frame.data(), sizeof frame), static_cast<ssize_t>(sizeof frame));
    EXPECT_EQ(frame[63], ~frame[0]);
    return frame[0];
  }

  std::array<std::array<int, 2>, 2> sockets_{};
  std::unique_ptr<Relay> relay_;
  std::thread thread_;
};

TEST_F(RelayTest, CarriesEveryFrameUnchangedAndInOrderBothWays) {
  start({});
  for (std::uint32_t i = 0; i < 2000; ++i) {
    send(0, i);
    send(1, i + 5000);
    ASSERT_EQ(next(1), i);
    ASSERT_EQ(next(0), i + 5000);
  }
  EXPECT_EQ(relay_->figures().sent, 4000u);
}

TEST_F(RelayTest, SendsNoFrameBeforeItsDelayHasPassed) {
  LinkProfile profile;
  profile.delay_ms = 30;
  start(profile);
  for (std::uint32_t i = 0; i < 10; ++i) {
    const auto before = std::chrono::steady_clock::now();
    send(0, i);
    ASSERT_EQ(next(1), i);
    EXPECT_GE(std::chrono::steady_clock::now() - before, std::chrono::milliseconds{30});
  }
}

TEST_F(RelayTest, LosesTheFramesThatItsLinkLoses) {
  LinkProfile profile;
  profile.loss = 0.2;
  profile.burst_start = 0.05;
  profile.burst_end = 0.3;
  constexpr std::uint32_t kCount = 3000;
  Link oracle{profile, 2 * 7};
  start(profile, 7);
  bool arrived = false;  // the last frame must arrive, so that the relay has handled all frames
  for (std::uint32_t i = 0; i < kCount || !arrived; ++i) {
    send(0, i);
    arrived = oracle.departure(0, 256).has_value();
    if (arrived) {
      ASSERT_EQ(next(1), i);
    }
  }
  stop();
  EXPECT_EQ(relay_->figures().a_to_b.lost, oracle.counts().lost);
  EXPECT_GT(oracle.counts().lost, 0u);
}

TEST_F(RelayTest, LetsFramesOvertakeOnlyWhenItsLinkDoes) {
  for (const bool reorder : {false, true}) {
    LinkProfile profile;
    profile.delay_ms = 20;
    profile.jitter_ms = 5;
    profile.reorder = reorder;
    start(profile);
    for (std::uint32_t i = 0; i < 200; ++i) send(0, i);
    int overtakes = 0;
    for (std::uint32_t i = 0, last = 0; i < 200; ++i) {
      const auto number = next(1);
      ASSERT_TRUE(number);
      if (*number < last) ++overtakes;
      last = *number;
    }
    EXPECT_EQ(overtakes > 0, reorder);
    stop();
  }
}

TEST_F(RelayTest, SendsRepeatedFramesTwiceInOrder) {
  LinkProfile profile;
  profile.repeat = 1;
  start(profile);
  for (std::uint32_t i = 0; i < 200; ++i) send(0, i);
  for (std::uint32_t i = 0; i < 200; ++i) {
    ASSERT_EQ(next(1), i);
    ASSERT_EQ(next(1), i);
  }
  stop();
  EXPECT_EQ(relay_->figures().a_to_b.repeated, 200u);
  EXPECT_EQ(relay_->figures().sent, 400u);
}

TEST_F(RelayTest, UsesNewProfilesForLaterFrames) {
  LinkProfile losing;
  losing.loss = 1;
  start(losing);
  send(0, 1);
  while (relay_->figures().a_to_b.lost == 0) std::this_thread::yield();
  relay_->set_profiles({}, losing);
  send(0, 2);
  EXPECT_EQ(next(1), 2u);
  send(1, 3);
  while (relay_->figures().b_to_a.lost == 0) std::this_thread::yield();
}

}  // namespace
}  // namespace tactus::netem
