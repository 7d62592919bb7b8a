/// Loads the XML profiles of a qos directory into the table that Fast DDS has for the whole process.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>

#include "wire/dds.hpp"

namespace tactus::wire {

/// Names of the traffic classes, by TrafficClass; also the names of their files, without `.xml`.
inline constexpr std::array<const char*, kTrafficClasses> kClassNames{"session", "probe", "bulk"};

/// Stores the durations of the profiles, so that the library does not parse them. For each duration the library would
/// compile three regular expressions, which takes 2.5 million instructions. For all durations together that is more
/// than the rest of a program's start.
class Durations {
 public:
  using Duration = eprosima::fastrtps::Duration_t;
  /// `element`: PARENT/NAME of the XML element.
  void add(const std::string& profile, const std::string& element, const Duration& value) {
    by_profile_[profile][element] = value;
  }
  /// Sets the durations of `profile` in a QoS that comes from the library's table.
  void apply(const std::string& profile, dds::DomainParticipantQos& qos) const;
  void apply(const std::string& profile, dds::DataWriterQos& qos) const;
  void apply(const std::string& profile, dds::DataReaderQos& qos) const;

 private:
  template <class Qos>
  void apply_to(const std::string& profile, Qos& qos) const;

  std::map<std::string, std::map<std::string, Duration>> by_profile_;
};

/// Replaces the library's table by the profiles of `directory` without their durations, and returns the durations.
/// Throws WireError with the file, the first invalid profile and the library's message. One thread at a time in the
/// whole process.
[[nodiscard]] Durations load_profiles(const std::filesystem::path& directory, LogCapture& log);

}  // namespace tactus::wire
