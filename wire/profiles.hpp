/// Reads the XML profiles of a qos directory into the table that Fast DDS keeps for the whole process.
#pragma once

#include <array>
#include <filesystem>

#include "wire/links.hpp"

namespace tactus::wire {

class LogCapture;

/// By TrafficClass; also the names of the files, without `.xml`.
inline constexpr std::array<const char*, kTrafficClasses> kClassNames{"session", "probe", "bulk"};

/// Replaces the library's table by the profiles of `directory`. Throws WireError naming the file, the first profile
/// that is broken and what the library says of it. One thread at a time in the whole process.
void load_profiles(const std::filesystem::path& directory, LogCapture& log);

}  // namespace tactus::wire
