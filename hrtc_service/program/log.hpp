/// Writes the log of an HRTC to the standard error output.
#pragma once

#include <string>

#include "session/severity.hpp"

namespace tactus::hrtc_service {

/// Names this process in each later line of the log.
void begin_log(const std::string& process);

/// Writes a line. Any thread, not the haptic one.
void log_event(session::Severity severity, const std::string& text);

}  // namespace tactus::hrtc_service
