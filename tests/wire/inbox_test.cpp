#include "wire/inbox.hpp"

#include <gtest/gtest.h>

namespace tactus::wire {
namespace {

using namespace std::chrono_literals;

TEST(InboxTest, DropsTheNewestSamplesAboveItsCapacityButKeepsPlacesForTheEndOfASession) {
  constexpr int kCapacity = 10, kEnd = 100;
  Inbox<int> inbox{kCapacity};
  for (int i = 0; i < kCapacity + 5; ++i) inbox.put(i);
  EXPECT_EQ(inbox.dropped(), 5u);
  inbox.put(kEnd, Urgency::kMustArrive);
  const auto taken = inbox.take(0us);
  ASSERT_EQ(taken.size(), static_cast<std::size_t>(kCapacity) + 1);
  for (int i = 0; i < kCapacity; ++i) EXPECT_EQ(taken[static_cast<std::size_t>(i)].sample, i);
  EXPECT_EQ(taken.back().sample, kEnd);
  for (int i = 0; i < kCapacity; ++i) inbox.put(i);
  for (int i = 0; i < 1000; ++i) inbox.put(kEnd, Urgency::kMustArrive);
  EXPECT_LT(inbox.take(0us).size(), 2u * kCapacity + 10) << "the reserve is limited too";
}

}  // namespace
}  // namespace tactus::wire
