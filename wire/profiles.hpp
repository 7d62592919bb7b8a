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

/// The profiles of a qos directory. Their durations are stored here, so that the library does not parse them. For each
/// duration the library would compile three regular expressions, which takes 2.5 million instructions. Parsing all
/// durations would take more time than the rest of a program's start.
class Profiles {
 public:
  /// `suffix`: added to the name of each profile in the library's table.
  explicit Profiles(std::string suffix) : suffix_{std::move(suffix)} {}
  /// `element`: PARENT/NAME of the XML element.
  void add(const std::string& profile, const std::string& element, const LibraryDuration& value) {
    durations_[profile][element] = value;
  }
  [[nodiscard]] const std::string& suffix() const noexcept { return suffix_; }

  /// Reads a profile; false if there is none with this name and kind.
  [[nodiscard]] bool read(dds::DomainParticipantFactory& factory, const std::string& profile,
                          dds::DomainParticipantQos& qos) const;
  [[nodiscard]] bool read(dds::Publisher& publisher, const std::string& profile, dds::DataWriterQos& qos) const;
  [[nodiscard]] bool read(dds::Subscriber& subscriber, const std::string& profile, dds::DataReaderQos& qos) const;

 private:
  template <class Qos>
  void apply_durations(const std::string& profile, Qos& qos) const;

  std::string suffix_;
  std::map<std::string, std::map<std::string, LibraryDuration>> durations_;
};

/// Loads the profiles of `directory`. Version 3.1 of the library cannot remove profiles from its table. Two folders with
/// equal files share one set of profiles; folders with different files get different suffixes, so that their names do not
/// conflict. Throws WireError with the file, the first invalid profile and the library's message. Only one thread of the
/// process may call this at a time.
[[nodiscard]] Profiles load_profiles(const std::filesystem::path& directory, LogCapture& log);

}  // namespace tactus::wire
