#include "hrtc_service/servo/shared_mailbox.hpp"

#include <gtest/gtest.h>

#include <random>
#include <thread>

namespace tactus::hrtc_service {
namespace {

/// A value is whole if all its numbers are equal. Its size is no multiple of 8.
struct Wide {
  std::array<std::uint32_t, 41> numbers{};

  explicit Wide(std::uint32_t number = 0) { numbers.fill(number); }
  [[nodiscard]] bool is_whole() const {
    return std::all_of(numbers.begin(), numbers.end(), [&](std::uint32_t number) { return number == numbers[0]; });
  }
};

TEST(SharedMailbox, IsEmptyUntilTheFirstPost) {
  SharedMailbox<int> mailbox;
  MailboxReader reader{mailbox, 7};
  int value = 1;
  EXPECT_FALSE(reader.take(value));
  EXPECT_EQ(value, 1);
  EXPECT_EQ(reader.latest(), 7);
}

TEST(SharedMailbox, GivesTheNewestValueOnceToEachReader) {
  SharedMailbox<Wide> mailbox;
  MailboxWriter writer{mailbox};
  MailboxReader first{mailbox}, second{mailbox};
  for (std::uint32_t i = 1; i <= 9; ++i) writer.post(Wide{i});
  for (MailboxReader<Wide>* const reader : {&first, &second}) {
    Wide value;
    EXPECT_TRUE(reader->take(value));
    EXPECT_EQ(value.numbers[40], 9u);
    EXPECT_FALSE(reader->take(value));
  }
  writer.post(Wide{10});
  EXPECT_EQ(first.latest().numbers[0], 10u);
  EXPECT_EQ(first.latest().numbers[0], 10u);
}

TEST(SharedMailbox, ALaterWriterContinuesAfterAHalfWrittenValue) {
  SharedMailbox<Wide> mailbox;
  MailboxReader reader{mailbox};
  MailboxWriter{mailbox}.post(Wide{1});
  for (std::size_t i = 0; i < 5; ++i) mailbox.slots[2].words[i] = 99;  // a writer died during its second post
  Wide value;
  ASSERT_TRUE(reader.take(value));
  EXPECT_EQ(value.numbers[0], 1u);
  MailboxWriter{mailbox}.post(Wide{2});
  ASSERT_TRUE(reader.take(value));
  EXPECT_TRUE(value.is_whole());
  EXPECT_EQ(value.numbers[0], 2u);
}

// The other process may write any number. Neither end may then access memory outside the mailbox, which ASan checks.
TEST(SharedMailbox, WrongNumbersOfTheOtherEndStayHarmless) {
  std::mt19937_64 random{20261126};
  SharedMailbox<Wide> mailbox;
  MailboxWriter writer{mailbox};
  MailboxReader reader{mailbox};
  int taken = 0;
  for (int step = 0; step < 10000; ++step) {
    writer.post(Wide{1});
    if (step % 3 == 0) mailbox.posted = random();
    Wide value;
    taken += reader.take(value) ? 1 : 0;
  }
  EXPECT_GT(taken, 0);
}

TEST(SharedMailbox, NeverGivesATornValueOrAnOlderValueAfterANewerOne) {
  SharedMailbox<Wide> mailbox;
  constexpr std::uint32_t kMinTaken = 2000;
  std::atomic<bool> is_done{false};
  std::thread producer{[&mailbox, &is_done] {
    MailboxWriter writer{mailbox};
    for (std::uint32_t number = 1; !is_done; ++number) writer.post(Wide{number});
  }};
  MailboxReader reader{mailbox};
  std::uint32_t newest = 0, taken = 0;
  bool are_whole = true, are_ascending = true;
  while (taken < kMinTaken && are_whole && are_ascending) {
    Wide value;
    if (!reader.take(value)) {
      std::this_thread::yield();
      continue;
    }
    are_whole = value.is_whole();
    are_ascending = value.numbers[0] > newest;
    newest = value.numbers[0];
    ++taken;
  }
  is_done = true;
  producer.join();
  EXPECT_TRUE(are_whole);
  EXPECT_TRUE(are_ascending);
}

}  // namespace
}  // namespace tactus::hrtc_service
