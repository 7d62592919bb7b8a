#include "event_log/limited_sink.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <memory>
#include <sstream>
#include <string>

namespace tactus::event_log {
namespace {

using namespace std::chrono_literals;

class LimitedSinkTest : public testing::Test {
 protected:
  LimitedSinkTest() { sink_.set_pattern("%l %v"); }

  void write(spdlog::log_clock::duration at, const std::string& text,
             spdlog::level::level_enum level = spdlog::level::warn) {
    sink_.log({kStart + at, {}, "host", level, text});
  }
  [[nodiscard]] std::size_t lines() const {
    const std::string text = out_.str();
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  }

  static constexpr spdlog::log_clock::time_point kStart{1'000'000s};
  std::ostringstream out_;
  LimitedSink sink_{std::make_shared<spdlog::sinks::ostream_sink_mt>(out_)};
};

TEST_F(LimitedSinkTest, AFloodOfWarningsLeavesRoomForOtherLevels) {
  for (int i = 0; i < 1000; ++i) write(i * 1ms, "hrtc desk restarted");
  EXPECT_EQ(lines(), LimitedSink::kMaxLines);
  write(1s, "the haptic thread has ended", spdlog::level::err);
  EXPECT_THAT(out_.str(), testing::EndsWith("error the haptic thread has ended\n"));
}

TEST_F(LimitedSinkTest, TheNextWindowBeginsWithTheNumberOfLinesThatWereLeftOut) {
  for (int i = 0; i < 1000; ++i) write(i * 1ms, "hrtc desk restarted");
  write(9999ms, "left out");
  write(10s, "hrtc desk has left");
  EXPECT_THAT(out_.str(), testing::EndsWith("restarted\n"
                                            "warning 801 lines were left out; the log has at most 200 of each level "
                                            "in 10 s\n"
                                            "warning hrtc desk has left\n"));
  write(20s, "hrtc desk joined");
  EXPECT_EQ(lines(), LimitedSink::kMaxLines + 3);
}

TEST_F(LimitedSinkTest, AClockThatIsSetBackBeginsAWindow) {
  for (int i = 0; i < 1000; ++i) write(i * 1ms, "hrtc desk restarted");
  write(-1h, "hrtc desk has left");
  EXPECT_THAT(out_.str(), testing::EndsWith("warning hrtc desk has left\n"));
}

TEST_F(LimitedSinkTest, ATextOfAnotherProgramNeitherBeginsALineNorCommandsTheTerminal) {
  write(0s, "emergency stop: x\n12:00:00.000 tactus-hrtc info forces are reset\x1b]52;c;eA==\x07\xc2\x9b");
  EXPECT_EQ(out_.str(), "warning emergency stop: x?12:00:00.000 tactus-hrtc info forces are reset?]52;c;eA==??\n");
}

}  // namespace
}  // namespace tactus::event_log
