/// Writes the log of a program to the standard error output, through LimitedSink.
#pragma once

#include <string>

#include "session/severity.hpp"

namespace tactus::event_log {

/// Names this process in each later line of the log.
void begin(const std::string& process);

/// Writes a line, with "?" for each control character. Any thread, not the haptic one.
void write(session::Severity severity, const std::string& text);

}  // namespace tactus::event_log
