#include "wire/inbox.hpp"

#include <gtest/gtest.h>

#include "wire/topics.hpp"

namespace tactus::wire {
namespace {

using namespace std::chrono_literals;

TEST(InboxTest, DropsTheNewestSamplesAboveItsCapacityButHasAReserveForSamplesThatAreSentOnce) {
  constexpr int kCapacity = 10, kOnce = 100;
  Inbox<int> inbox{kCapacity};
  for (int i = 0; i < kCapacity + 5; ++i) inbox.put(i);
  EXPECT_EQ(inbox.dropped(), 5u);
  inbox.put(kOnce, Urgency::kMustArrive);
  const auto taken = inbox.take(0us);
  ASSERT_EQ(taken.size(), static_cast<std::size_t>(kCapacity) + 1);
  for (int i = 0; i < kCapacity; ++i) EXPECT_EQ(taken[static_cast<std::size_t>(i)].sample, i);
  EXPECT_EQ(taken.back().sample, kOnce);
  for (int i = 0; i < kCapacity; ++i) inbox.put(i);
  for (int i = 0; i < 5000; ++i) inbox.put(kOnce, Urgency::kMustArrive);
  EXPECT_EQ(inbox.take(0us).size(), 1024u + kCapacity) << "the reserve is limited too";
}

static_assert(kIsSentOnce<session::CatalogueEntry> && !kIsSentOnce<session::RosterEntry>);

}  // namespace
}  // namespace tactus::wire
