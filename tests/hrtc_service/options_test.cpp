// The limits of the options of tactus-hrtc, and of the tool that one of them names.

#include "hrtc_service/program/options.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "hrtc_service/program/opened_devices.hpp"
#include "spm/pool.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::hrtc_service {
namespace {

using testing::AllOf;
using testing::HasSubstr;

ReadOptions options_of(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "tactus-hrtc");
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  return read_options(static_cast<int>(argv.size()), argv.data());
}

/// Returns the error message of refused options.
std::string refusal(const std::vector<std::string>& arguments) {
  testing::internal::CaptureStderr();
  const ReadOptions found = options_of(arguments);
  std::string message = testing::internal::GetCapturedStderr();
  EXPECT_FALSE(found.options);
  EXPECT_EQ(found.exit_status, 2);
  return message;
}

TEST(HrtcOptions, APoolHas256To2To24Slots) {
  constexpr std::uint32_t kMin = 256, kMax = 16'777'216;
  for (const std::uint32_t slots : {kMin, kMax}) {
    const ReadOptions accepted = options_of({"--pool", std::to_string(slots)});
    ASSERT_TRUE(accepted.options) << slots;
    EXPECT_EQ(accepted.options->pool.slots, slots);
  }
  for (const std::uint32_t slots : {kMin - 1, kMax + 1})
    EXPECT_THAT(refusal({"--pool", std::to_string(slots)}),
                AllOf(HasSubstr("--pool"), HasSubstr(std::to_string(slots)), HasSubstr("256"), HasSubstr("16777216")));
}

TEST(HrtcOptions, MemoryHoldsAPoolOf256To2To24Slots) {
  const std::uint64_t memory = 2 * spm::PoolSettings::for_slots(spm::kMaxSlots).bytes();
  const ReadOptions accepted = options_of({"--memory", std::to_string(memory)});
  ASSERT_TRUE(accepted.options);
  EXPECT_EQ(accepted.options->pool.slots, 16'777'216u);
  EXPECT_THAT(refusal({"--memory", "1000"}), AllOf(HasSubstr("--memory"), HasSubstr("expected room for 256")));
}

TEST(HrtcOptions, OneTo65536RegionsOfAnObjectAreRefinedAtATime) {
  for (const std::uint32_t targets : {1u, 65'536u}) {
    const ReadOptions accepted = options_of({"--targets", std::to_string(targets)});
    ASSERT_TRUE(accepted.options) << targets;
    EXPECT_EQ(accepted.options->servo.cycle.targets, targets);
  }
  for (const char* targets : {"0", "65537"})
    EXPECT_THAT(refusal({"--targets", targets}), AllOf(HasSubstr("--targets"), HasSubstr(targets), HasSubstr("65536")));
}

TEST(HrtcOptions, TheDeadlineIsAShareOfThePeriodUnlessItIsGiven) {
  const auto deadline_ns = [](const std::vector<std::string>& arguments) {
    const ReadOptions accepted = options_of(arguments);
    return accepted.options ? accepted.options->haptic.deadline_ns : 0;
  };
  EXPECT_EQ(deadline_ns({}), 250'000);
  EXPECT_EQ(deadline_ns({"--tool", "stylus"}), 400'000);
  EXPECT_EQ(deadline_ns({"--rate", "100"}), 2'500'000) << "refinement has the same share of the time at each rate";
  EXPECT_EQ(deadline_ns({"--rate", "10000"}), 25'000);
  EXPECT_EQ(deadline_ns({"--rate", "100", "--deadline", "60"}), 60'000);
}

TEST(HrtcOptions, NumbersAreFinite) {
  const std::vector<std::pair<std::string, std::string>> options{
      {"--rate", "in range 100 to 10000"},
      {"--deadline", "in range 20 to 10000"},
      {"--tip-radius", "in range 0.1 to 100"},
      {"--max-force", "in range 0.1 to 100"},
      {"--max-torque", "in range 0.001 to 10"},
      {"--gateway-patience", "in range 0 to 3600"},
      {"--device-scale", "in range 0.001 to 1000"},
      {"--flight-recorder", "in range 0 to 3600"},
      {"--wait-host", "a finite number of at least 0"},
      {"--state-rate", "in range 1 to 10000"},
  };
  for (const auto& [option, expected] : options)
    for (const char* number : {"nan", "-nan(1)", "inf", "-inf", "1e999"})
      EXPECT_THAT(refusal({option, number}), HasSubstr(option + ": Value " + number + " not " + expected));
  for (const char* number : {"nan", "inf"})
    EXPECT_THAT(refusal({"--device-offset", "0", number, "0"}),
                HasSubstr(std::string{"--device-offset: Value "} + number + " not a finite number"));
}

TEST(HrtcOptions, AVertexOfAToolIsAtMostOneMetreFromItsTip) {
  const test_support::TemporaryFolder folder;
  const std::string file = folder.path() / "tool.obj";
  const auto load = [&](const char* height) {
    test_support::write_bytes(file, std::string{"v 0 0 "} + height + "\nv 0.01 0 0\nv 0 0.01 0\nf 1 2 3\n");
    return load_tool(file);
  };
  EXPECT_EQ(load("1")->radius(), 1);
  EXPECT_THAT([&] { (void)load("1.001"); },
              testing::ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("--tool " + file + ": found a vertex at 1.001"), HasSubstr("at most 1"))));
  EXPECT_THAT([&] { (void)load("1e39"); }, testing::ThrowsMessage<std::runtime_error>(HasSubstr("tool.obj: ")));
}

}  // namespace
}  // namespace tactus::hrtc_service
