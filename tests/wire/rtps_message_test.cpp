#include "wire/rtps_message.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace tactus::wire {
namespace {

/// A message of submessages with these heads, each with a body of so many bytes.
struct Part {
  std::uint8_t id, flags;
  std::uint16_t length;
  std::size_t body;
};
std::vector<std::uint8_t> message(const std::vector<Part>& parts) {
  std::vector<std::uint8_t> bytes(kRtpsHeader, 7);
  for (const Part& part : parts) {
    const auto low = static_cast<std::uint8_t>(part.length), high = static_cast<std::uint8_t>(part.length >> 8);
    const bool little = (part.flags & 1) != 0;
    bytes.insert(bytes.end(), {part.id, part.flags, little ? low : high, little ? high : low});
    bytes.insert(bytes.end(), part.body, kStatisticsId);  // what looks like their beginning is none
  }
  return bytes;
}
std::uint32_t kept(const std::vector<Part>& parts) {
  const std::vector<std::uint8_t> bytes = message(parts);
  return size_without_statistics(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
}

TEST(RtpsMessageTest, AMessageEndsBeforeItsStatistics) {
  EXPECT_EQ(kept({{kDataId, 5, 300, 300}, {kStatisticsId, 0, 56, 56}}), 20u + 304u);
  EXPECT_EQ(kept({{kDataId, 4, 300, 300}, {kStatisticsId, 1, 56, 56}, {kPadId, 1, 4, 4}}), 20u + 304u) << "big-endian";
  EXPECT_EQ(kept({{kInfoTimeId, 3, 0, 0}, {kStatisticsId, 1, 56, 56}}), 20u + 4u) << "a time of no length is not last";
  EXPECT_EQ(kept({{kStatisticsId, 1, 0xffff, 2}}), 20u);
  EXPECT_EQ(kept({{kDataId, 1, 5, 8}, {kStatisticsId, 1, 56, 56}}), 20u + 12u) << "submessages begin at multiples of 4";
}

TEST(RtpsMessageTest, AMessageWithoutThemIsWhole) {
  EXPECT_EQ(kept({}), 20u);
  EXPECT_EQ(kept({{kDataId, 1, 80, 80}}), 20u + 84u);
  EXPECT_EQ(kept({{kDataId, 1, 0, 84}}), 20u + 88u) << "of no length: to the end";
  EXPECT_EQ(kept({{kDataId, 1, 200, 80}}), 20u + 84u) << "longer than the message";
}

TEST(RtpsMessageTest, WhatLooksLikeStatisticsAtTheEndIsMovedByPaddings) {
  std::vector<std::uint8_t> plain(200, 1), alike(200, kStatisticsId);
  plain.resize(200 + kMostPaddings);
  alike.resize(200 + kMostPaddings);

  EXPECT_EQ(pad_what_looks_like_statistics(plain.data(), 200), 200u);
  const std::uint32_t size = pad_what_looks_like_statistics(alike.data(), 200);

  EXPECT_EQ(size, 200u + 60);  // only the first padding is no 0x80 there
  EXPECT_NE(alike[size - 60], kStatisticsId);
}

TEST(RtpsMessageTest, NothingIsReadBeyondTheEnd) {
  const std::vector<std::uint8_t> whole = message({{kPadId, 1, 4, 4}, {kDataId, 1, 8, 8}, {kStatisticsId, 1, 56, 56}});
  for (std::uint32_t size = 0; size <= whole.size(); ++size) {
    const std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + size);
    EXPECT_LE(size_without_statistics(cut.data(), size), size);  // sanitizers would tell
  }
}

}  // namespace
}  // namespace tactus::wire
