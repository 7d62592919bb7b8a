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

TEST(Mailbox, NeverShowsATornValueNorAnOlderOneAfterANewerOne) {
  // A value is consistent when all its words are equal; ThreadSanitizer checks the accesses.
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
  std::uint64_t seen = 0;
  bool whole = true;
  bool ascending = true;
  while (seen < kLast && whole && ascending) {
    Wide value{};
    if (!box.take(value)) {
      std::this_thread::yield();
      continue;
    }
    for (const std::uint64_t word : value.words) whole = whole && word == value.words[0];
    ascending = value.words[0] > seen;
    seen = value.words[0];
  }
  producer.join();
  EXPECT_TRUE(whole);
  EXPECT_TRUE(ascending);
}

}  // namespace
}  // namespace tactus::haptics
