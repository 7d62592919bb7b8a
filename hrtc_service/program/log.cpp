#include "hrtc_service/program/log.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

namespace tactus::hrtc_service {

void begin_log(const std::string& process) {
  spdlog::set_default_logger(spdlog::stderr_color_mt(process));
  spdlog::set_pattern("%H:%M:%S.%e %n %^%l%$ %v");
}

void log_event(session::Severity severity, const std::string& text) {
  constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::info, spdlog::level::warn, spdlog::level::err};
  spdlog::log(kLevels[static_cast<std::size_t>(severity)], "{}", text);
}

}  // namespace tactus::hrtc_service
