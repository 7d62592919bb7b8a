#include "wire/transport/trimming.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "rtps_bytes.hpp"

namespace tactus::wire {
namespace {

using namespace test;

const Bytes kHeartbeat{0x07, 0x01, 28, 0, 0, 0, 0, 0, 0, 0, 3, 2, 0, 0, 0, 0,
                       1,    0,    0,  0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};

/// A sample of a writer of this kind, with `bytes` bytes after its encapsulation header.
Bytes sample(std::uint8_t kind = 0x02, std::size_t bytes = 4) {
  const std::size_t length = 24 + bytes;
  Bytes made{0x15, 0x05, static_cast<std::uint8_t>(length), static_cast<std::uint8_t>(length >> 8)};
  made.insert(made.end(), {0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 3, kind, 0, 0, 0, 0, 7, 0, 0, 0, 0, 1, 0, 0});
  made.insert(made.end(), bytes, 42);
  return made;
}
Bytes statistics() {
  Bytes made{0x80, 0x01, 56, 0};
  made.resize(60);
  return made;
}
/// The trimmed message; empty if `trim` leaves the message unchanged.
Bytes trimmed(const Bytes& bytes) {
  TrimmedMessage out;
  if (!trim(bytes.data(), static_cast<std::uint32_t>(bytes.size()), out)) return {};
  return Bytes(out.bytes.begin(), out.bytes.begin() + out.size);
}

TEST(TrimmingTest, RemovesDestinationTimeAndStatistics) {
  EXPECT_EQ(trimmed(message_of({kInfoDestination, kInfoTime, sample(), statistics()})), message_of({sample()}));
  EXPECT_EQ(trimmed(message_of({kInfoTime, sample(), statistics()})), message_of({sample()}))
      << "without a destination";
}

/// An encrypted submessage of this size.
Bytes encrypted(std::size_t size) {
  Bytes made = submessage(kSecurePrefixId, Bytes(20, 1));
  for (const Bytes& part : {submessage(kSecureBodyId, Bytes(4 + size, 2)), submessage(kSecurePostfixId, Bytes(40, 3))})
    made.insert(made.end(), part.begin(), part.end());
  return made;
}

TEST(TrimmingTest, OfAnEncryptedMessageOnlyTheSampleRemains) {
  const Bytes time = encrypted(12), data = encrypted(40);
  EXPECT_EQ(trimmed(message_of({kInfoDestination, time, data, statistics()})), message_of({data}));
  EXPECT_EQ(trimmed(message_of({time, data, statistics()})), message_of({data}));
  EXPECT_TRUE(trimmed(message_of({data, data, statistics()})).empty()) << "two samples";
  EXPECT_TRUE(trimmed(message_of({time, data, data, statistics()})).empty());
  EXPECT_TRUE(trimmed(message_of({time, data, kHeartbeat, statistics()})).empty());
  EXPECT_TRUE(trimmed(message_of({time, statistics()})).empty());
}

TEST(TrimmingTest, OtherMessagesAreUnchanged) {
  constexpr std::uint8_t kBuiltIn = 0xc2;

  EXPECT_TRUE(trimmed(message_of({})).empty());
  EXPECT_TRUE(trimmed(message_of({kInfoDestination, kInfoTime})).empty());
  EXPECT_TRUE(trimmed(message_of({kInfoDestination, kInfoTime, sample()})).empty()) << "no statistics";
  EXPECT_TRUE(trimmed(message_of({kInfoDestination, kInfoTime, sample(), sample(), statistics()})).empty());
  EXPECT_TRUE(trimmed(message_of({kInfoDestination, kInfoTime, sample(), kHeartbeat, statistics()})).empty());
  EXPECT_TRUE(trimmed(message_of({kInfoTime, sample(kBuiltIn), statistics()})).empty()) << "a sample of discovery";
  EXPECT_TRUE(trimmed(message_of({kInfoDestination, kInfoTime, sample(kBuiltIn), statistics()})).empty());
}

TEST(TrimmingTest, ATrimmedMessageThatLooksLikeStatisticsIsPadded) {
  Bytes lookalike = sample(0x02, 56);
  lookalike[lookalike.size() - 60] = kStatisticsId;

  const Bytes padded = trimmed(message_of({kInfoDestination, kInfoTime, lookalike, statistics()}));

  ASSERT_EQ(padded.size(), message_of({lookalike}).size() + kSubmessageHeader);
  EXPECT_NE(padded[padded.size() - kStatisticsSize], kStatisticsId);
}

TEST(TrimmingTest, NoPartOfAMessageIsReadBeyondItsEnd) {
  const Bytes whole = message_of({kInfoDestination, kInfoTime, sample(), statistics()});
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_TRUE(trimmed(cut).empty()) << size;  // sanitizers detect reads beyond the end
  }
}

TEST(TrimmingTest, AMessageTooLongForTheBufferIsUnchanged) {
  EXPECT_TRUE(trimmed(message_of({kInfoDestination, kInfoTime, sample(0x02, 2000), statistics()})).empty());
}

}  // namespace
}  // namespace tactus::wire
