#include <unistd.h>

#include <cstdio>
#include <fastdds/dds/log/Log.hpp>
#include <memory>
#include <mutex>
#include <set>
#include <utility>

#include "session/printable.hpp"
#include "wire/dds.hpp"

namespace tactus::wire {
namespace {

struct LogState {
  std::mutex mutex;
  LogSink sink;
  bool capturing = false;
  std::string captured;
  std::set<std::string> reported;
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
      state.sink(session::Severity::kWarning, "dds: " + entry.message);
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

const char* name_of(dds::QosPolicyId_t policy) {
  switch (policy) {
    case dds::DURABILITY_QOS_POLICY_ID:
      return "durability";
    case dds::RELIABILITY_QOS_POLICY_ID:
      return "reliability";
    case dds::OWNERSHIP_QOS_POLICY_ID:
      return "ownership";
    case dds::DEADLINE_QOS_POLICY_ID:
      return "deadline";
    case dds::LIVELINESS_QOS_POLICY_ID:
      return "liveliness";
    case dds::DATAREPRESENTATION_QOS_POLICY_ID:
      return "data representation";
    default:
      return "QoS";
  }
}

}  // namespace

void report(const std::string& text, session::Severity severity) {
  LogState& state = log_state();
  const std::lock_guard<std::mutex> lock{state.mutex};
  if (!state.reported.insert(text).second) return;
  if (state.sink)
    state.sink(severity, text);
  else if (::isatty(STDERR_FILENO) != 0)
    std::fprintf(stderr, "\x1b[31m%s\x1b[0m\n", session::printable(text).c_str());  // red
  else
    std::fprintf(stderr, "%s\n", session::printable(text).c_str());
}

void report_mismatch(const char* own, const char* other, const std::string& topic, dds::QosPolicyId_t policy) {
  report("the " + std::string{own} + " of topic " + topic + " does not match a " + other +
         " of another program, because their " + name_of(policy) +
         " differs; do all programs have the same files in --qos?");
}

void set_log_sink(LogSink sink) {
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
