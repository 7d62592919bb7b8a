#include "spm/codec/received_records.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

namespace tactus::spm::codec {
namespace {

std::uint64_t add_all(ReceivedRecords& received, const std::vector<std::uint32_t>& records) {
  std::uint64_t again = 0;
  for (const std::uint32_t record : records) again += received.add(RecordId{record});
  return again;
}

std::vector<std::uint32_t> shuffled(std::uint32_t count, std::mt19937& random) {
  std::vector<std::uint32_t> records(count);
  std::iota(records.begin(), records.end(), 0u);
  std::shuffle(records.begin(), records.end(), random);
  return records;
}

TEST(ReceivedRecords, IsExactForASmallModel) {
  std::mt19937 random{1};
  std::vector<std::uint32_t> records = shuffled(ReceivedRecords::kMaxStored - 1, random);
  ReceivedRecords received;
  EXPECT_EQ(add_all(received, records), 0u);
  records.resize(1000);
  EXPECT_EQ(add_all(received, records), 1000u);
  EXPECT_EQ(add_all(received, records), 1000u) << "each further time counts, too";
}

TEST(ReceivedRecords, NoRecordOfALargeModelCountsTheFirstTime) {
  std::mt19937 random{2};
  ReceivedRecords received;
  EXPECT_EQ(add_all(received, shuffled(1'000'000, random)), 0u);
}

// The tolerance is five standard errors.
TEST(ReceivedRecords, EstimatesTheRecordsOfALargeModelThatComeAgain) {
  std::mt19937 random{3};
  for (const std::uint32_t count : {10'000u, 100'000u, 2'000'000u}) {
    std::vector<std::uint32_t> records = shuffled(count, random);
    ReceivedRecords received;
    add_all(received, records);
    const std::uint32_t share = 3;  // a third comes again: in runs, as in the lists of regions
    std::erase_if(records, [](std::uint32_t record) { return record / 500 % share != 0; });
    const auto expected = static_cast<double>(records.size());
    const double counted = std::min(expected, ReceivedRecords::kMaxStored / 2.0 / share);
    EXPECT_NEAR(static_cast<double>(add_all(received, records)), expected, 5 * expected / std::sqrt(counted)) << count;
  }
}

// A host could choose ids whose hashes all begin with zeros.
TEST(ReceivedRecords, TheSubsetStaysSmallWithAnyIds) {
  ReceivedRecords received;
  std::vector<std::uint32_t> in_subset;
  constexpr std::uint64_t kGoldenRatio = 0x9e3779b97f4a7c15ull;
  for (std::uint32_t record = 0; in_subset.size() < 20'000; ++record)
    if (record * kGoldenRatio >> 56 == 0) in_subset.push_back(record);
  add_all(received, in_subset);
  EXPECT_LE(received.stored(), ReceivedRecords::kMaxStored);
  EXPECT_GT(received.stored(), 0u);
}

}  // namespace
}  // namespace tactus::spm::codec
