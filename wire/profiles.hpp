/// Reads the XML profiles of a qos directory into the table that Fast DDS keeps for the whole process.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>

#include "wire/dds.hpp"

namespace tactus::wire {

/// By TrafficClass; also the names of the files, without `.xml`.
inline constexpr std::array<const char*, kTrafficClasses> kClassNames{"session", "probe", "bulk"};

/// Durations of profiles, kept out of the library's table: it compiles three regular expressions for each, 2.5 million
/// instructions, more than for all the rest of a program's start.
class Durations {
 public:
  using Duration = eprosima::fastrtps::Duration_t;
  /// `element` is its name, with that of its parent before it.
  void add(const std::string& profile, const std::string& element, const Duration& value) {
    by_profile_[profile][element] = value;
  }
  /// To what the library's table has of that profile.
  void apply(const std::string& profile, dds::DomainParticipantQos& qos) const;
  void apply(const std::string& profile, dds::DataWriterQos& qos) const;
  void apply(const std::string& profile, dds::DataReaderQos& qos) const;

 private:
  template <class Qos>
  void apply_to(const std::string& profile, Qos& qos) const;

  std::map<std::string, std::map<std::string, Duration>> by_profile_;
};

/// Replaces the library's table by the profiles of `directory`; gives the durations that it left out of them. Throws
/// WireError naming the file, the first profile that is broken and what the library says of it. One thread at a time in
/// the whole process.
[[nodiscard]] Durations load_profiles(const std::filesystem::path& directory, LogCapture& log);

}  // namespace tactus::wire
