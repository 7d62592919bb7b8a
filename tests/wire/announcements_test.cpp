#include "wire/transport/announcements.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/constants.hpp"

namespace tactus::wire {
namespace {

using rtps::IPLocator;
using Locator = Announcements::Locator;

Locator locator(const char* address, std::uint32_t port) {
  Locator made;
  IPLocator::createLocator(LOCATOR_KIND_UDPv4, address, port, made);
  return made;
}

/// An RTPS message with a time and a sample, little-endian, as Fast DDS sends them. The sample announces a participant
/// with the locator 10.0.0.1:7410 and, if `name` is not empty, a name of four letters.
std::vector<std::uint8_t> message(std::uint8_t writer_kind, std::uint8_t sequence, std::uint8_t sender = 1,
                                  const std::string& name = {}, bool has_inline_qos = false) {
  const auto length = static_cast<std::uint8_t>((name.empty() ? 56 : 72) + (has_inline_qos ? 12 : 0));
  const std::uint8_t flags = has_inline_qos ? 0x07 : 0x05;
  std::vector<std::uint8_t> bytes(20, sender);                                                // header
  bytes.insert(bytes.end(), {0x09, 0x01, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0});                      // time
  bytes.insert(bytes.end(), {0x15, flags, length, 0, 0, 0, 16, 0, 0, 1, 0, 0xc7});            // sample, reader
  bytes.insert(bytes.end(), {0, 1, 0, writer_kind, 0, 0, 0, 0, sequence, 0, 0, 0});           // writer, number
  if (has_inline_qos) bytes.insert(bytes.end(), {0x0f, 0x80, 4, 0, 9, 9, 9, 9, 1, 0, 0, 0});  // a parameter, sentinel
  bytes.insert(bytes.end(), {0, 3, 0, 0, 0x32, 0, 24, 0, 1, 0, 0, 0, 0xf2, 0x1c, 0, 0});      // parameter, kind, port
  bytes.insert(bytes.end(), {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 10, 0, 0, 1});
  if (!name.empty()) {
    bytes.insert(bytes.end(), {0x62, 0, 12, 0, 5, 0, 0, 0});
    bytes.insert(bytes.end(), name.begin(), name.end());
    bytes.insert(bytes.end(), {0, 0, 0, 0});
  }
  bytes.insert(bytes.end(), {1, 0, 0, 0});
  return bytes;
}

const Locator kGroup = locator("239.255.0.1", 7400);
const Locator kAnn = locator("10.0.0.1", 7410);
const Locator kBob = locator("10.0.0.2", 7410);
const int kSocket = 0, kOtherSocket = 0;

TEST(AnnouncementsTest, OnlyASampleOfTheParticipantWriterIsAnAnnouncement) {
  const std::vector<std::uint8_t> announcement = message(0xc2, 7);
  const std::vector<std::uint8_t> sample = message(0x02, 7);

  EXPECT_EQ(Announcements::sequence_of(announcement.data(), static_cast<std::uint32_t>(announcement.size())), 7u);
  EXPECT_FALSE(Announcements::sequence_of(sample.data(), static_cast<std::uint32_t>(sample.size())));
}

TEST(AnnouncementsTest, NoPartOfAMessageIsReadBeyondItsEnd) {
  const std::vector<std::uint8_t> whole = message(0xc2, 7);
  Announcements announcements;
  for (std::uint32_t size = 0; size < whole.size(); ++size) {
    const std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + size);
    const std::uint32_t read_to = 20 + 12 + 4 + 20;
    EXPECT_EQ(Announcements::sequence_of(cut.data(), size).has_value(), size >= read_to) << size;
    (void)announcements.on_received(cut.data(), size);  // sanitizers detect reads beyond the end
  }
}

TEST(AnnouncementsTest, SendsToANewLocatorAtOnceAndNotAgainToTheOthers) {
  Announcements announcements;
  (void)announcements.due(&kSocket, 1, {kGroup, kAnn}, 0);

  EXPECT_EQ(announcements.due(&kSocket, 1, {kGroup, kAnn, kBob}, 10 * kMs), (std::vector<Locator>{kBob}));
}

TEST(AnnouncementsTest, RepeatsToTheGroupAfterItsInterval) {
  Announcements announcements;
  (void)announcements.due(&kSocket, 1, {kGroup, kAnn}, 0);

  EXPECT_EQ(announcements.due(&kSocket, 1, {kGroup, kAnn}, 100 * kMs), (std::vector<Locator>{kGroup}));
}

TEST(AnnouncementsTest, RepeatsToALocatorLessOftenThanToTheGroup) {
  Announcements announcements;
  const auto announce = [&](std::int64_t now_ns) {
    const auto published = announcements.due(&kSocket, 1, {kAnn}, now_ns);
    (void)announcements.due(&kSocket, 1, {kGroup}, now_ns);
    return published.size();
  };
  (void)announcements.due(&kSocket, 1, {kGroup}, 0);
  std::size_t published = 0;

  for (std::int64_t ms = 500; ms <= 4500; ms += 500) published += announce(ms * kMs);

  EXPECT_EQ(published, 3u);  // at 0.5, 2.5 and 4.5 s
}

TEST(AnnouncementsTest, WithoutAGroupRepeatsToAllAfterTheGroupInterval) {
  Announcements announcements;
  (void)announcements.due(&kSocket, 1, {kAnn, kBob}, 0);

  EXPECT_EQ(announcements.due(&kSocket, 1, {kAnn, kBob}, 100 * kMs), (std::vector<Locator>{kAnn, kBob}));
}

TEST(AnnouncementsTest, SendsAChangedAnnouncementToAllAtOnce) {
  Announcements announcements;
  (void)announcements.due(&kSocket, 1, {kGroup, kAnn}, 0);

  EXPECT_EQ(announcements.due(&kSocket, 2, {kGroup, kAnn}, 1 * kMs), (std::vector<Locator>{kGroup, kAnn}));
}

TEST(AnnouncementsTest, SendsToANewParticipantAtAUsedLocatorAtOnce) {
  const std::vector<std::uint8_t> first = message(0xc2, 1, 1), second = message(0xc2, 1, 2);
  Announcements announcements;
  const auto receive = [&](const std::vector<std::uint8_t>& from) {
    (void)announcements.on_received(from.data(), static_cast<std::uint32_t>(from.size()));
  };
  receive(first);
  (void)announcements.due(&kSocket, 1, {kGroup, kAnn, kBob}, 0);
  receive(first);
  EXPECT_TRUE(announcements.due(&kSocket, 1, {kGroup, kAnn, kBob}, 1 * kMs).empty());

  receive(second);

  EXPECT_EQ(announcements.due(&kSocket, 1, {kGroup, kAnn, kBob}, 2 * kMs), (std::vector<Locator>{kAnn}));
}

TEST(AnnouncementsTest, DropsAnnouncementsOfTheIgnoredName) {
  Announcements announcements{"crew"};
  const auto is_accepted = [&](const std::vector<std::uint8_t>& from) {
    return announcements.on_received(from.data(), static_cast<std::uint32_t>(from.size()));
  };

  EXPECT_FALSE(is_accepted(message(0xc2, 1, 1, "crew")));
  EXPECT_FALSE(is_accepted(message(0xc2, 2, 1, "crew"))) << "also with a later sequence number";
  EXPECT_FALSE(is_accepted(message(0xc2, 1, 4, "crew", true))) << "with inline QoS, as Fast DDS sends it";
  EXPECT_TRUE(is_accepted(message(0xc2, 1, 2, "crow")));
  EXPECT_TRUE(is_accepted(message(0xc2, 1, 3)));
  EXPECT_TRUE(is_accepted(message(0x02, 1, 1, "crew"))) << "a sample of another writer";
}

TEST(AnnouncementsTest, SendsOnEachInterface) {
  Announcements announcements;
  (void)announcements.due(&kSocket, 1, {kGroup}, 0);

  EXPECT_EQ(announcements.due(&kOtherSocket, 1, {kGroup}, 1 * kMs), (std::vector<Locator>{kGroup}));
}

}  // namespace
}  // namespace tactus::wire
