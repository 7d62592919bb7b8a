#include "wire/transport/gate.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace tactus::wire {
namespace {

using namespace std::chrono_literals;

TEST(GateTest, BlocksUntilOpened) {
  Gate gate{24h};
  std::atomic<bool> opening{false};
  std::thread opener{[&] {
    std::this_thread::yield();
    opening = true;
    gate.open();
  }};

  gate.pass();

  EXPECT_TRUE(opening);
  opener.join();
}

TEST(GateTest, DoesNotBlockOnceOpen) {
  Gate gate{24h};
  gate.open();
  std::thread other{[&] { gate.pass(); }};

  gate.pass();

  other.join();  // both threads have passed the gate
}

TEST(GateTest, StopsBlockingAfterTheTimeout) {
  Gate gate{1ms};

  gate.pass();  // returns although nobody opens the gate
}

}  // namespace
}  // namespace tactus::wire
