#include "hrtc_service/servo/shared_ring.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <random>
#include <thread>
#include <vector>

namespace tactus::hrtc_service {
namespace {

using testing::ElementsAre;

TEST(SharedRing, PassesEntriesInOrderAcrossItsEnd) {
  SharedRing<int, 8> ring;
  RingWriter writer{ring};
  RingReader reader{ring};
  for (int first = 0; first < 100; first += 5) {
    std::array<int, 5> sent;
    std::iota(sent.begin(), sent.end(), first);
    ASSERT_EQ(writer.push(std::span<const int>{sent}), 5u);
    ASSERT_EQ(writer.space(), 3u);
    std::array<int, 8> received{};
    ASSERT_EQ(reader.pop(std::span{received}), 5u);
    ASSERT_TRUE(std::equal(sent.begin(), sent.end(), received.begin()));
  }
}

TEST(SharedRing, AFullRingTakesOnlyWhatFits) {
  SharedRing<int, 4> ring;
  RingWriter writer{ring};
  RingReader reader{ring};
  const std::vector<int> sent{1, 2, 3, 4, 5};
  EXPECT_EQ(writer.push(std::span{sent}), 4u);
  EXPECT_FALSE(writer.push(6));
  int entry = 0;
  ASSERT_TRUE(reader.pop(entry));
  EXPECT_EQ(entry, 1);
  EXPECT_TRUE(writer.push(7));
  std::array<int, 4> received{};
  EXPECT_EQ(reader.pop(std::span{received}), 4u);
  EXPECT_THAT(received, ElementsAre(2, 3, 4, 7));
  EXPECT_FALSE(reader.pop(entry));
}

TEST(SharedRing, ALaterWriterAndReaderContinueWhereTheEarlierOnesEnded) {
  SharedRing<int, 4> ring;
  ASSERT_TRUE(RingWriter{ring}.push(1));
  ASSERT_TRUE(RingWriter{ring}.push(2));
  int entry = 0;
  ASSERT_TRUE(RingReader{ring}.pop(entry));
  EXPECT_EQ(entry, 1);
  ASSERT_TRUE(RingReader{ring}.pop(entry));
  EXPECT_EQ(entry, 2);
}

// The other process may write any positions. Neither end may then access memory outside the ring, which ASan checks.
TEST(SharedRing, WrongPositionsOfTheOtherEndStayHarmless) {
  std::mt19937_64 random{20261126};
  SharedRing<std::uint32_t, 16> ring;
  RingWriter writer{ring};
  RingReader reader{ring};
  std::array<std::uint32_t, 32> entries{};
  for (int step = 0; step < 10000; ++step) {
    if (step % 3 == 0) ring.pushed = random();
    if (step % 5 == 0) ring.popped = random();
    ASSERT_LE(writer.push(std::span<const std::uint32_t>{entries}), 16u);
    ASSERT_LE(reader.pop(std::span{entries}), 16u);
  }
}

TEST(SharedRing, PassesEntriesBetweenThreads) {
  SharedRing<std::uint32_t, 64> ring;
  constexpr std::uint32_t kCount = 200'000;
  std::thread producer{[&ring] {
    RingWriter writer{ring};
    for (std::uint32_t number = 0; number < kCount;)
      if (writer.push(number))
        ++number;
      else
        std::this_thread::yield();
  }};
  RingReader reader{ring};
  for (std::uint32_t number = 0, entry = 0; number < kCount;) {
    if (!reader.pop(entry)) {
      std::this_thread::yield();
      continue;
    }
    ASSERT_EQ(entry, number++);
  }
  producer.join();
}

}  // namespace
}  // namespace tactus::hrtc_service
