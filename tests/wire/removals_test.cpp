#include "wire/transport/removals.hpp"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "rtps_bytes.hpp"
#include "wire/transport/protection.hpp"

namespace tactus::wire {
namespace {

using namespace test;

constexpr GuidPrefix kSender{9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 1}, kRemoved{2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1},
    kOther{3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 1};

/// The announcement of kSender, with one parameter.
Bytes announcement() {
  return data({kAnnouncements.begin(), kAnnouncements.end()}, 5,
              {0, 3, 0, 0, 2, 0, 8, 0, 4, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0});
}
bool names(const Bytes& message, const GuidPrefix& participant) {
  return names_removal_of(participant, message.data(), static_cast<std::uint32_t>(message.size()));
}
Bytes completed(const Bytes& message, const std::vector<GuidPrefix>& removed) {
  return with_removals(message.data(), static_cast<std::uint32_t>(message.size()), removed);
}

TEST(RemovalsTest, AnAnnouncementNamesTheRemovedParticipants) {
  const Bytes message = message_of({kInfoTime, announcement(), kInfoDestination}, kSender);
  const Bytes named = completed(message, {kOther, kRemoved});
  EXPECT_EQ(named.size(), message.size() + 4 + 2 * kRemoved.size());
  EXPECT_TRUE(names(named, kRemoved));
  EXPECT_TRUE(names(named, kOther));
  EXPECT_FALSE(names(named, kSender));
  EXPECT_FALSE(names(message, kRemoved));
  const auto size = static_cast<std::uint32_t>(named.size());
  EXPECT_EQ(refusal_of(named.data(), size), Refusal::kNone);
  const auto last = find_submessage(named.data(), size, kInfoDestinationId);
  ASSERT_TRUE(last) << "the length of the announcement leads to the next submessage";
  EXPECT_EQ(last->next, size);
}

TEST(RemovalsTest, AnAnnouncementWithoutLengthNamesThemToo) {
  Bytes without_length = announcement();
  without_length[2] = without_length[3] = 0;
  EXPECT_TRUE(names(completed(message_of({kInfoTime, without_length}, kSender), {kRemoved}), kRemoved));
}

TEST(RemovalsTest, OnlyTheFirstOfManyRemovedParticipantsAreNamed) {
  std::vector<GuidPrefix> removed(kMaxNamedRemovals, kOther);
  removed.push_back(kRemoved);
  EXPECT_FALSE(names(completed(message_of({announcement()}, kSender), removed), kRemoved));
  std::swap(removed.front(), removed.back());
  EXPECT_TRUE(names(completed(message_of({announcement()}, kSender), removed), kRemoved));
}

TEST(RemovalsTest, ABigEndianAnnouncementNamesThemToo) {
  Bytes big = data({kAnnouncements.begin(), kAnnouncements.end()}, 5,
                   {0, 2, 0, 0, 0, 2, 0, 8, 0, 0, 0, 4, 0, 0, 0, 0, 0, 1, 0, 0});
  big[1] = 0x04;
  std::swap(big[2], big[3]);
  std::swap(big[6], big[7]);
  const Bytes named = completed(message_of({big, kInfoDestination}, kSender), {kRemoved});
  EXPECT_TRUE(names(named, kRemoved));
  EXPECT_TRUE(find_submessage(named.data(), static_cast<std::uint32_t>(named.size()), kInfoDestinationId));
}

TEST(RemovalsTest, OtherMessagesNameNobody) {
  const Bytes sample = message_of({kInfoTime, data({0, 0, 1, 2}, 1, {0, 3, 0, 0, 1, 0, 0, 0})}, kSender);
  EXPECT_TRUE(completed(sample, {kRemoved}).empty());
}

TEST(RemovalsTest, ACutMessageIsReadWithinItsEnd) {
  const Bytes named = completed(message_of({kInfoTime, announcement()}, kSender), {kOther, kRemoved});
  for (std::size_t size = 0; size < named.size(); ++size) {
    const Bytes cut(named.begin(), named.begin() + static_cast<std::ptrdiff_t>(size));
    (void)names(cut, kRemoved);  // sanitizers detect reads beyond the end
    (void)completed(cut, {kRemoved});
  }
}

}  // namespace
}  // namespace tactus::wire
