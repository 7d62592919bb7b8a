#include "wire/direct.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <string>
#include <vector>

namespace tactus::wire {
namespace {

using eprosima::fastrtps::rtps::GuidPrefix_t;
using Bytes = std::vector<std::uint8_t>;

GuidPrefix_t prefix(std::uint8_t value) {
  GuidPrefix_t made;
  std::fill(made.value, made.value + 12, value);
  return made;
}

const Bytes kHead{'R', 'T', 'P', 'S', 2, 2, 1, 15, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
const Bytes kTime{0x09, 0x01, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0};
const Bytes kHeartbeat{0x07, 0x01, 28, 0, 0, 0, 0, 0, 0, 0, 3, 2, 0, 0, 0, 0,
                       1,    0,    0,  0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};

Bytes to(std::uint8_t participant) {
  Bytes made{0x0e, 0x01, 12, 0};
  made.insert(made.end(), 12, participant);
  return made;
}
/// Number 7 of writer 00 00 03 with an encapsulation and four bytes.
Bytes sample(std::uint8_t flags = 0x05, std::uint8_t kind = 0x02) {
  return {0x15, flags, 28, 0, 0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 3, kind, 0, 0, 0, 0, 7, 0, 0, 0, 0, 1, 0, 0, 42, 0, 0, 0};
}
Bytes message(const std::vector<Bytes>& parts) {
  Bytes made = kHead;
  for (const Bytes& part : parts) made.insert(made.end(), part.begin(), part.end());
  return made;
}
std::optional<EncodedSample> sole(const Bytes& bytes) {
  return sole_sample(bytes.data(), static_cast<std::uint32_t>(bytes.size()), prefix(9));
}

TEST(DirectTest, TheOneSampleOfAMessageIsFoundWithItsWriterAndNumber) {
  const Bytes bytes = message({to(9), kTime, sample()});

  const std::optional<EncodedSample> found = sole(bytes);

  ASSERT_TRUE(found);
  EXPECT_EQ(found->writer.guidPrefix, prefix(1));
  EXPECT_EQ(found->writer.entityId.value[2], 3);
  EXPECT_EQ(found->sequence, 7u);
  EXPECT_EQ(Bytes(found->bytes, found->bytes + found->size), (Bytes{0, 1, 0, 0, 42, 0, 0, 0}));
}

TEST(DirectTest, WhatIsOfAnotherShapeIsLeftToTheLibrary) {
  constexpr std::uint8_t kWithInlineQos = 0x07, kKeyOnly = 0x09, kBuiltInWriter = 0xc2;

  EXPECT_FALSE(sole(message({})));
  EXPECT_FALSE(sole(message({kTime})));
  EXPECT_FALSE(sole(message({sample(), sample()})));
  EXPECT_FALSE(sole(message({sample(), kHeartbeat})));
  EXPECT_FALSE(sole(message({sample(kWithInlineQos)})));
  EXPECT_FALSE(sole(message({sample(kKeyOnly)})));
  EXPECT_FALSE(sole(message({sample(0x05, kBuiltInWriter)})));
  for (const Bytes& number : {Bytes(8, 0), Bytes(8, 0xff)}) {
    Bytes no_number = sample();
    std::copy(number.begin(), number.end(), no_number.begin() + 16);
    EXPECT_FALSE(sole(message({no_number}))) << "no sample has the number 0 or a negative one";
  }
  EXPECT_FALSE(sole(message({to(8), sample()}))) << "is for another participant";
  EXPECT_TRUE(sole(message({to(0), sample()}))) << "is for any";
}

TEST(DirectTest, NoPartOfAMessageIsReadBeyondItsEnd) {
  const Bytes whole = message({to(9), kTime, sample()});
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    const std::optional<EncodedSample> found = sole(cut);  // sanitizers would tell
    EXPECT_TRUE(!found || found->bytes + found->size == cut.data() + cut.size()) << size;
  }
}

TEST(DirectTest, WhateverChangesInAMessageItsSampleIsWithinIt) {
  const Bytes whole = message({to(9), kTime, sample(), kHeartbeat});
  DirectPath path;
  path.set_own(prefix(9));
  std::minstd_rand random{7};
  std::uint32_t found = 0, bytes_seen = 0;
  const auto taker = std::make_shared<DirectTaker>([&](const std::uint8_t* bytes, std::uint32_t size) {
    for (std::uint32_t i = 0; i < size; ++i) bytes_seen += bytes[i];  // sanitizers would tell
  });
  DirectPath::Guid writer;
  writer.guidPrefix = prefix(1);
  writer.entityId = {0x00000302};
  for (int i = 0; i < 20000; ++i) {
    Bytes changed(whole.begin(), whole.end() - static_cast<std::ptrdiff_t>(random() % 40));
    for (std::size_t left = random() % 3; left > 0; --left)
      changed[random() % changed.size()] = static_cast<std::uint8_t>(random() % 2 == 0 ? random() : random() % 32);
    const std::optional<EncodedSample> one = sole(changed);
    found += one ? 1 : 0;
    if (one) {
      ASSERT_GE(one->bytes, changed.data());
      ASSERT_LE(one->bytes + one->size, changed.data() + changed.size());
    }
    path.on_writer(writer, taker);
    (void)path.on_received(changed.data(), static_cast<std::uint32_t>(changed.size()));
    path.on_writer_lost(writer, taker);  // or one high number would be the last taken
  }
  EXPECT_GT(found, 1000u);
  EXPECT_GT(bytes_seen, 1000u);
}

TEST(DirectTest, ATakerGetsWhatIsNewerAndCountsWhatWasLeftOut) {
  int taken = 0;
  DirectTaker taker{[&](const std::uint8_t*, std::uint32_t) { ++taken; }};
  std::uint64_t newest = 0;
  const auto come = [&](std::uint64_t number) { taker.take({{}, number, nullptr, 0}, newest); };
  for (const std::uint64_t number : {5, 6, 6, 4, 9}) come(number);

  EXPECT_EQ(taken, 3);
  EXPECT_EQ(taker.lost(), 2u);  // 7 and 8; those before the first were not for this reader

  taker.close();
  come(10);
  EXPECT_EQ(taken, 3);
}

}  // namespace
}  // namespace tactus::wire
