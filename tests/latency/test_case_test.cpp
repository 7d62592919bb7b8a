#include "latency/test_case.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <set>

#include "latency/schedule.hpp"

namespace tactus::latency {
namespace {

using testing::HasSubstr;

template <class Change>
std::string refusal(Change change) {
  TestCase test;
  change(test);
  try {
    check(test);
  } catch (const LatencyError& error) {
    return error.what();
  }
  return "";
}

TEST(ATestCase, IsRefusedWithTheValueFoundAndTheValuesExpected) {
  EXPECT_EQ(refusal([](TestCase&) {}), "");
  EXPECT_THAT(refusal([](TestCase& test) { test.rate_hz = 50'000; }),
              HasSubstr("rate, Hz, is 50000; expected 0.1 to 20000"));
  EXPECT_THAT(refusal([](TestCase& test) { test.readers = 0; }), HasSubstr("readers is 0; expected 1 to 64"));
  EXPECT_THAT(refusal([](TestCase& test) { test.seconds = 0; }), HasSubstr("seconds is 0"));
  EXPECT_THAT(refusal([](TestCase& test) { test.load_mbit = -3; }), HasSubstr("load, Mbit/s, is -3"));
  EXPECT_THAT(refusal([](TestCase& test) { test.payload = 64; }), HasSubstr("a probe state always has 236"));
  EXPECT_THAT(refusal([](TestCase& test) { test.topic = Topic::kRecords, test.payload = 1201; }),
              HasSubstr("expected 32 to 1200"));
  EXPECT_THAT(refusal([](TestCase& test) { test.transport = Transport::kShm, test.link = "P4"; }),
              HasSubstr("bypasses link P4"));
  EXPECT_THAT(refusal([](TestCase& test) {
                test.topic = Topic::kRecords, test.payload = 64, test.coding = Coding::kDeadbandCoded;
              }),
              HasSubstr("expected topic probe_state"));
  EXPECT_THAT(refusal([](TestCase& test) { test.transport = Transport::kShm, test.profile = Profile::kTuned; }),
              HasSubstr("profile tuned: expected transport udp"));
  EXPECT_THAT(refusal([](TestCase& test) { test.transport = Transport::kCyclone, test.load_mbit = 50; }),
              HasSubstr("transport cyclone: "));
  EXPECT_THAT(refusal([](TestCase& test) { test.seconds = 3600, test.readers = 64; }),
              HasSubstr("rate x seconds x readers"));
}

TEST(ATestCase, IsTheSameAfterAConversionToJsonAndBack) {
  TestCase test;
  test.transport = Transport::kBuiltin;
  test.profile = Profile::kPlain;
  test.topic = Topic::kRecords;
  test.payload = 700;
  test.rate_hz = 12.5;
  test.readers = 3;
  test.load_mbit = kUnpaced;
  test.seconds = 2.25;
  const TestCase converted = test_from_json(to_json(test));
  EXPECT_EQ(describe(converted), describe(test));
  EXPECT_EQ(to_json(converted), to_json(test));
  TestCase coded;
  coded.coding = Coding::kDeadbandCoded;
  EXPECT_THAT(describe(test_from_json(to_json(coded))), HasSubstr("1000 Hz coded x1"));
}

TEST(ATestCase, HasAPingAtEachTickOrAtEachDeadbandCodedState) {
  TestCase test;
  EXPECT_THAT(ticks_of(test), testing::SizeIs(5000));
  test.coding = Coding::kDeadbandCoded;
  const std::vector<std::uint32_t> ticks = ticks_of(test);
  EXPECT_GT(ticks.size(), 5000u / 40);
  EXPECT_LT(ticks.size(), 5000u / 4);
  std::uint32_t max_gap = 0;
  for (std::size_t i = 1; i < ticks.size(); ++i) max_gap = std::max(max_gap, ticks[i] - ticks[i - 1]);
  EXPECT_LE(max_gap, 40u);
}

TEST(ATestCase, FromTheNetworkIsRefusedIfAValueIsInvalid) {
  auto json = to_json(TestCase{});
  json["transport"] = "tcp";
  EXPECT_THROW((void)test_from_json(json), LatencyError);
  json = to_json(TestCase{});
  json["readers"] = 1'000'000;
  EXPECT_THROW((void)test_from_json(json), LatencyError);
  json = to_json(TestCase{});
  json["seconds"] = "long";
  EXPECT_THROW((void)test_from_json(json), LatencyError);
  json.erase("link");
  EXPECT_THROW((void)test_from_json(json), LatencyError);
  EXPECT_THROW((void)test_from_json(nlohmann::ordered_json::array()), LatencyError);
}

TEST(AGrid, HasEveryCombinationAndRawUdpOnceForAllProfilesAndTopics) {
  Grid grid;
  grid.transports = {Transport::kRawUdp, Transport::kUdp};
  grid.profiles = {Profile::kTactus, Profile::kPlain};
  grid.rates = {100, 1000};
  grid.loads = {0, 50};
  grid.repetitions = 2;
  const std::vector<TestCase> tests = grid.tests();
  std::set<std::string> descriptions;
  for (const TestCase& test : tests) descriptions.insert(describe(test));
  EXPECT_EQ(descriptions.size(), (1u + 2u) * 2 * 2);
  EXPECT_EQ(tests.size(), 2 * descriptions.size());
  // Repetitions alternate: the second half equals the first.
  for (std::size_t i = 0; i < descriptions.size(); ++i)
    EXPECT_EQ(describe(tests[i]), describe(tests[i + descriptions.size()]));
}

}  // namespace
}  // namespace tactus::latency
