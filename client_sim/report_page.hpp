/// Writes the results of a session as one HTML page with tables and plots.
#pragma once

#include <string>

#include "client_sim/report.hpp"

namespace tactus::client_sim {

/// Returns a page that needs no other file. It has the figures of the text report that fit in tables, each user's force
/// and the ages of the probe states over time, and the events.
[[nodiscard]] std::string html(const Report& report);

}  // namespace tactus::client_sim
