#include "haptics/mailbox.hpp"

#include <gtest/gtest.h>

#include <thread>

namespace tactus::haptics {
namespace {

TEST(Mailbox, IsEmptyUntilTheFirstPost) {
  Mailbox<int> box{7};
  int value = 1;
  EXPECT_FALSE(box.take(value));
  EXPECT_EQ(value, 1);
  EXPECT_EQ(box.latest(), 7);
}

TEST(Mailbox, GivesTheNewestPostOnce) {
  Mailbox<int> box;
  for (int i = 1; i <= 5; ++i) box.post(i);
  int value = 0;
  EXPECT_TRUE(box.take(value));
  EXPECT_EQ(value, 5);
  EXPECT_FALSE(box.take(value));
  EXPECT_EQ(box.latest(), 5);
  box.post(6);
  EXPECT_EQ(box.latest(), 6);
}

TEST(Mailbox, NeverGivesATornValueOrAnOlderValueAfterANewerOne) {
  // A value is consistent if all its words are equal. ThreadSanitizer checks the memory accesses.
  struct Wide {
    std::uint64_t words[40];
  };
  Mailbox<Wide> box{Wide{}};
  constexpr std::uint64_t kLast = 200000;
  std::thread producer{[&] {
    Wide value{};
    for (std::uint64_t i = 1; i <= kLast; ++i) {
      for (std::uint64_t& word : value.words) word = i;
      box.post(value);
    }
  }};
  std::uint64_t last_value = 0;
  bool consistent = true;
  bool ascending = true;
  while (last_value < kLast && consistent && ascending) {
    Wide value{};
    if (!box.take(value)) {
      std::this_thread::yield();
      continue;
    }
    for (const std::uint64_t word : value.words) consistent = consistent && word == value.words[0];
    ascending = value.words[0] > last_value;
    last_value = value.words[0];
  }
  producer.join();
  EXPECT_TRUE(consistent);
  EXPECT_TRUE(ascending);
}

}  // namespace
}  // namespace tactus::haptics
