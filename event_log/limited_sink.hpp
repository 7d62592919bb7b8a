/// Limits the number of lines in a log, so that another program of the session cannot fill the disk, and replaces the
/// control characters in each line.
#pragma once

#include <spdlog/sinks/dist_sink.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

#include "session/printable.hpp"

namespace tactus::event_log {

/// Passes at most kMaxLines lines of each level in kWindow to another sink. Replaces control characters, so that a text
/// of another program stays within its line. If lines were left out, the next window begins with a line that states
/// their number. Any thread.
class LimitedSink final : public spdlog::sinks::dist_sink<std::mutex> {
 public:
  static constexpr std::uint32_t kMaxLines = 200;
  static constexpr std::chrono::seconds kWindow{10};

  explicit LimitedSink(spdlog::sink_ptr to) { add_sink(std::move(to)); }

 protected:
  void sink_it_(const spdlog::details::log_msg& line) override {
    if (line.time - begin_ >= kWindow || line.time < begin_) {
      write_left_out(line);
      begin_ = line.time;
      lines_ = {};
    }
    if (++lines_[static_cast<std::size_t>(line.level)] > kMaxLines)
      ++left_out_;
    else
      write_printable(line);
  }

 private:
  void write_printable(const spdlog::details::log_msg& line) {
    const std::string text = session::printable({line.payload.data(), line.payload.size()});
    spdlog::details::log_msg printable = line;
    printable.payload = text;
    dist_sink::sink_it_(printable);
  }

  /// Writes how many lines were left out, with the time of `next`.
  void write_left_out(const spdlog::details::log_msg& next) {
    if (left_out_ == 0) return;
    const std::string text = std::to_string(left_out_) + " lines were left out; the log has at most " +
                             std::to_string(kMaxLines) + " of each level in " + std::to_string(kWindow.count()) + " s";
    left_out_ = 0;
    dist_sink::sink_it_({next.time, {}, next.logger_name, spdlog::level::warn, text});
  }

  spdlog::log_clock::time_point begin_;  // of the window
  std::array<std::uint32_t, spdlog::level::n_levels> lines_{};
  std::uint64_t left_out_ = 0;
};

}  // namespace tactus::event_log
