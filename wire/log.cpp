#include <fastdds/dds/log/Log.hpp>
#include <memory>
#include <mutex>
#include <utility>

#include "wire/dds.hpp"

namespace tactus::wire {
namespace {

struct LogState {
  std::mutex mutex;
  std::function<void(const std::string&)> sink;
  bool capturing = false;
  std::string captured;
};

LogState& log_state() {
  static LogState* state = new LogState;  // outlives the library's logging thread
  return *state;
}

class Consumer final : public dds::LogConsumer {
 public:
  void Consume(const dds::Log::Entry& entry) override {
    LogState& state = log_state();
    const std::lock_guard<std::mutex> lock{state.mutex};
    if (state.capturing) {
      state.captured += (state.captured.empty() ? "" : "; ") + entry.message;
    } else if (state.sink) {
      state.sink(entry.message);
    }
  }
};

/// Redirects the library's messages from the standard output to the consumer above. Further calls do nothing.
void redirect_log() {
  static const bool once = [] {
    dds::Log::ClearConsumers();
    dds::Log::RegisterConsumer(std::make_unique<Consumer>());
    dds::Log::SetVerbosity(dds::Log::Kind::Error);
    return true;
  }();
  static_cast<void>(once);
}

}  // namespace

void set_log_sink(std::function<void(const std::string&)> sink) {
  redirect_log();
  LogState& state = log_state();
  const std::lock_guard<std::mutex> lock{state.mutex};
  state.sink = std::move(sink);
}

LogCapture::LogCapture() {
  redirect_log();
  dds::Log::Flush();
  LogState& state = log_state();
  const std::lock_guard<std::mutex> lock{state.mutex};
  state.capturing = true;
  state.captured.clear();
}

LogCapture::~LogCapture() {
  LogState& state = log_state();
  const std::lock_guard<std::mutex> lock{state.mutex};
  state.capturing = false;
}

std::string LogCapture::take() {
  dds::Log::Flush();
  LogState& state = log_state();
  const std::lock_guard<std::mutex> lock{state.mutex};
  return std::exchange(state.captured, {});
}

}  // namespace tactus::wire
