#include "event_log/event_log.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>

#include "event_log/limited_sink.hpp"

namespace tactus::event_log {

void begin(const std::string& process) {
  const auto sink = std::make_shared<LimitedSink>(std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  spdlog::set_default_logger(std::make_shared<spdlog::logger>(process, sink));
  spdlog::set_pattern("%H:%M:%S.%e %n %^%l%$ %v");
}

void write(session::Severity severity, const std::string& text) {
  constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::info, spdlog::level::warn, spdlog::level::err};
  spdlog::log(kLevels[static_cast<std::size_t>(severity)], "{}", text);
}

}  // namespace tactus::event_log
