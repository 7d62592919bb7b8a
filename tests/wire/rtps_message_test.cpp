#include "wire/transport/rtps_message.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

namespace tactus::wire {
namespace {

/// A submessage. `length` is the length that its header states, `body` the number of bytes after the header.
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
    bytes.insert(bytes.end(), part.body, kStatisticsId);  // in a body, this byte is no id
  }
  return bytes;
}
std::uint32_t size_before_statistics(const std::vector<Part>& parts) {
  const std::vector<std::uint8_t> bytes = message(parts);
  return size_without_statistics(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
}

TEST(RtpsMessageTest, TheSizeEndsAtTheFirstStatisticsSubmessage) {
  EXPECT_EQ(size_before_statistics({{kDataId, 5, 300, 300}, {kStatisticsId, 0, 56, 56}}), 20u + 304u);
  EXPECT_EQ(size_before_statistics({{kDataId, 4, 300, 300}, {kStatisticsId, 1, 56, 56}, {kPadId, 1, 4, 4}}), 20u + 304u)
      << "big-endian";
  EXPECT_EQ(size_before_statistics({{kInfoTimeId, 3, 0, 0}, {kStatisticsId, 1, 56, 56}}), 20u + 4u)
      << "an INFO_TS submessage of length 0 is empty and does not extend to the end";
  EXPECT_EQ(size_before_statistics({{kStatisticsId, 1, 0xffff, 2}}), 20u);
  EXPECT_EQ(size_before_statistics({{kDataId, 1, 5, 8}, {kStatisticsId, 1, 56, 56}}), 20u + 12u)
      << "submessages begin at multiples of 4";
}

TEST(RtpsMessageTest, AMessageWithoutStatisticsIsUnchanged) {
  EXPECT_EQ(size_before_statistics({}), 20u);
  EXPECT_EQ(size_before_statistics({{kDataId, 1, 80, 80}}), 20u + 84u);
  EXPECT_EQ(size_before_statistics({{kDataId, 1, 0, 84}}), 20u + 88u) << "length 0: extends to the end";
  EXPECT_EQ(size_before_statistics({{kDataId, 1, 200, 80}}), 20u + 84u) << "longer than the message";
}

TEST(RtpsMessageTest, PadsOnlyAMessageThatSeemsToEndWithStatistics) {
  std::vector<std::uint8_t> plain(200, 1), lookalike(200, kStatisticsId);
  plain.resize(200 + kMaxPadding);
  lookalike.resize(200 + kMaxPadding);

  EXPECT_EQ(pad_if_it_looks_like_statistics(plain.data(), 200), 200u);
  const std::uint32_t size = pad_if_it_looks_like_statistics(lookalike.data(), 200);

  EXPECT_EQ(size, 200u + 60);  // then the byte 60 before the end is the first byte of the padding
  EXPECT_NE(lookalike[size - 60], kStatisticsId);
}

using Bytes = std::vector<std::uint8_t>;
Bytes concat(const std::vector<Bytes>& parts) {
  Bytes all;
  for (const Bytes& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}
Bytes bytes_of(const RtpsBytes& bytes) { return Bytes(bytes.at, bytes.at + bytes.size); }
/// A little-endian message of one DATA submessage. Entity id of the writer: 0 0 3 2; sequence number: 7 * 2^32 + 9.
Bytes data_message(std::uint8_t flags, const Bytes& content) {
  const auto length = static_cast<std::uint8_t>(20 + content.size());
  return concat({Bytes(kRtpsHeader, 1),
                 {kDataId, flags, length, 0, 0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 3, 2, 7, 0, 0, 0, 9, 0, 0, 0},
                 content});
}
std::optional<RtpsData> data_in(const Bytes& bytes) {
  const auto found = find_submessage(bytes.data(), static_cast<std::uint32_t>(bytes.size()), kDataId);
  return found ? data_of(*found) : std::nullopt;
}
// Flags of a DATA submessage: 1 little-endian, 2 with inline QoS, 4 with data, 8 with a key instead of data.
constexpr std::uint8_t kLittleWithData = 0x05, kLittleWithInlineQos = 0x07, kLittleKeyOnly = 0x09;
// kInlineQos and kPayload each contain one parameter and the sentinel. kPayload starts with its encapsulation header
// and ends with one more byte.
const Bytes kInlineQos{0x70, 0, 4, 0, 9, 9, 9, 9, 1, 0, 0, 0};
const Bytes kPayload{0, 3, 0, 0, 0x62, 0, 4, 0, 5, 6, 7, 8, 1, 0, 0, 0, 99};

TEST(RtpsMessageTest, ReadsWriterSequenceAndPayloadOfASample) {
  const Bytes plain = data_message(kLittleWithData, kPayload);
  const Bytes with_qos = data_message(kLittleWithInlineQos, concat({kInlineQos, kPayload}));
  for (const Bytes& bytes : {plain, with_qos}) {
    const std::optional<RtpsData> data = data_in(bytes);
    ASSERT_TRUE(data);
    EXPECT_EQ(data->writer, (std::array<std::uint8_t, 4>{0, 0, 3, 2}));
    EXPECT_FALSE(data->is_built_in());
    EXPECT_EQ(data->sequence, (std::uint64_t{7} << 32) + 9);
    EXPECT_EQ(bytes_of(data->payload), kPayload);
  }
}

TEST(RtpsMessageTest, ASampleWithOnlyAKeyHasNoPayload) {
  const Bytes bytes = data_message(kLittleKeyOnly, kPayload);
  const std::optional<RtpsData> data = data_in(bytes);
  ASSERT_TRUE(data);
  EXPECT_EQ(data->payload.size, 0u);
}

TEST(RtpsMessageTest, ParametersEndAtTheSentinel) {
  const Bytes bytes = data_message(kLittleWithData, kPayload);
  ParameterList parameters = parameters_of(data_in(bytes)->payload);

  const auto first = parameters.next();

  ASSERT_TRUE(first);
  EXPECT_EQ(first->id, 0x62u);
  EXPECT_EQ(bytes_of(first->value), (Bytes{5, 6, 7, 8}));
  EXPECT_FALSE(parameters.next());
  EXPECT_FALSE(parameters.next());
  EXPECT_EQ(bytes_of(parameters.rest()), Bytes{99});
}

TEST(RtpsMessageTest, AParameterLongerThanItsListIsNotReturned) {
  const Bytes list{0x62, 0, 5, 0, 1, 2, 3, 4};
  ParameterList parameters{{list.data(), static_cast<std::uint32_t>(list.size()), true}};  // little-endian
  EXPECT_FALSE(parameters.next());
}

TEST(RtpsMessageTest, PartsOfACorruptedSampleLieInsideTheMessage) {
  const Bytes valid = data_message(kLittleWithInlineQos, concat({kInlineQos, kPayload}));
  std::minstd_rand random{7};
  std::uint32_t found = 0;
  for (int i = 0; i < 20000; ++i) {
    Bytes changed(valid.begin(), valid.end() - static_cast<std::ptrdiff_t>(random() % 40));
    for (std::size_t changes = random() % 3; changes > 0; --changes)
      changed[kRtpsHeader + random() % (changed.size() - kRtpsHeader)] = static_cast<std::uint8_t>(random() % 256);
    const std::optional<RtpsData> data = data_in(changed);
    if (!data) continue;
    ++found;
    const auto is_inside = [&](const RtpsBytes& bytes) {
      return bytes.at >= changed.data() && bytes.at + bytes.size <= changed.data() + changed.size();
    };
    ASSERT_TRUE(is_inside(data->payload));
    ParameterList parameters = parameters_of(data->payload);
    while (const auto parameter = parameters.next()) ASSERT_TRUE(is_inside(parameter->value));
  }
  EXPECT_GT(found, 1000u);
}

TEST(RtpsMessageTest, NothingIsReadBeyondTheEnd) {
  const std::vector<std::uint8_t> whole = message({{kPadId, 1, 4, 4}, {kDataId, 1, 8, 8}, {kStatisticsId, 1, 56, 56}});
  for (std::uint32_t size = 0; size <= whole.size(); ++size) {
    const std::vector<std::uint8_t> cut(whole.begin(), whole.begin() + size);
    EXPECT_LE(size_without_statistics(cut.data(), size), size);  // sanitizers detect reads beyond the end
  }
}

}  // namespace
}  // namespace tactus::wire
