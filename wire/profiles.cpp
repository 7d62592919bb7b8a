#include "wire/profiles.hpp"

#include <fastrtps/xmlparser/XMLProfileManager.h>
#include <tinyxml2.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <system_error>
#include <vector>

namespace tactus::wire {
namespace {

using Duration = Durations::Duration;

/// An XML element that contains a duration, and the field of the QoS that the element sets.
template <class Qos>
struct DurationField {
  const char* element;
  Duration& (*in)(Qos& qos);
};

const std::vector<DurationField<dds::DomainParticipantQos>>& duration_fields(const dds::DomainParticipantQos&) {
  using Qos = dds::DomainParticipantQos;
  static const std::vector<DurationField<Qos>> all{
      {"discovery_config/leaseDuration",
       [](Qos& q) -> Duration& { return q.wire_protocol().builtin.discovery_config.leaseDuration; }},
      {"discovery_config/leaseAnnouncement",
       [](Qos& q) -> Duration& { return q.wire_protocol().builtin.discovery_config.leaseDuration_announcementperiod; }},
      {"discovery_config/clientAnnouncementPeriod",
       [](Qos& q) -> Duration& {
         return q.wire_protocol().builtin.discovery_config.discoveryServer_client_syncperiod;
       }},
      {"initialAnnouncements/period",
       [](Qos& q) -> Duration& { return q.wire_protocol().builtin.discovery_config.initial_announcements.period; }}};
  return all;
}
const std::vector<DurationField<dds::DataWriterQos>>& duration_fields(const dds::DataWriterQos&) {
  using Qos = dds::DataWriterQos;
  static const std::vector<DurationField<Qos>> all{
      {"reliability/max_blocking_time", [](Qos& q) -> Duration& { return q.reliability().max_blocking_time; }},
      {"times/initialHeartbeatDelay",
       [](Qos& q) -> Duration& { return q.reliable_writer_qos().times.initialHeartbeatDelay; }},
      {"times/heartbeatPeriod", [](Qos& q) -> Duration& { return q.reliable_writer_qos().times.heartbeatPeriod; }},
      {"times/nackResponseDelay", [](Qos& q) -> Duration& { return q.reliable_writer_qos().times.nackResponseDelay; }}};
  return all;
}
const std::vector<DurationField<dds::DataReaderQos>>& duration_fields(const dds::DataReaderQos&) {
  using Qos = dds::DataReaderQos;
  static const std::vector<DurationField<Qos>> all{
      {"times/initialAcknackDelay",
       [](Qos& q) -> Duration& { return q.reliable_reader_qos().times.initialAcknackDelay; }},
      {"times/heartbeatResponseDelay",
       [](Qos& q) -> Duration& { return q.reliable_reader_qos().times.heartbeatResponseDelay; }}};
  return all;
}

/// Reads a number below `limit` in decimal digits; none for any other text.
std::optional<std::uint32_t> number_of(const tinyxml2::XMLElement& element, std::uint32_t limit) {
  const char* const text = element.GetText();
  constexpr std::size_t kMaxDigits = 9;
  if (text == nullptr || *text == '\0' || std::strlen(text) > kMaxDigits) return std::nullopt;
  std::uint32_t value = 0;
  for (const char* c = text; *c != '\0'; ++c) {
    if (*c < '0' || *c > '9') return std::nullopt;
    value = 10 * value + static_cast<std::uint32_t>(*c - '0');
  }
  return value < limit ? std::optional{value} : std::nullopt;
}

/// Reads a duration that consists of <sec> and <nanosec>; none for any other form, which the library has to read.
std::optional<Duration> duration_of(const tinyxml2::XMLElement& element) {
  const auto* const seconds = element.FirstChildElement("sec");
  const auto* const rest = element.FirstChildElement("nanosec");
  if (seconds == nullptr || rest == nullptr || seconds->NextSiblingElement() != rest ||
      element.FirstChildElement() != seconds || element.LastChildElement() != rest)
    return std::nullopt;
  const auto s = number_of(*seconds, 1'000'000'000), ns = number_of(*rest, 1'000'000'000);
  if (!s || !ns) return std::nullopt;
  return Duration{static_cast<std::int32_t>(*s), *ns};
}

/// Moves the durations that `duration_fields` lists from the profile into `into`.
template <class Qos>
void take_durations(tinyxml2::XMLElement& from, const std::string& profile,
                    const std::vector<DurationField<Qos>>& duration_fields, Durations& into) {
  for (auto* child = from.FirstChildElement(); child != nullptr;) {
    auto* const element = child;
    child = child->NextSiblingElement();
    const std::string name = std::string{from.Name()} + "/" + element->Name();
    const bool known = std::any_of(duration_fields.begin(), duration_fields.end(),
                                   [&](const auto& field) { return name == field.element; });
    const std::optional<Duration> value = known ? duration_of(*element) : std::nullopt;
    if (value) {
      into.add(profile, name, *value);
      from.DeleteChild(element);
    } else {
      take_durations(*element, profile, duration_fields, into);
    }
  }
}
void take_durations(tinyxml2::XMLDocument& document, Durations& into) {
  auto* const root = document.FirstChildElement("dds");
  auto* const profiles = root != nullptr ? root->FirstChildElement("profiles") : nullptr;
  if (profiles == nullptr) return;
  for (auto* profile = profiles->FirstChildElement(); profile != nullptr; profile = profile->NextSiblingElement()) {
    const char* const name = profile->Attribute("profile_name");
    if (name == nullptr) continue;
    const std::string kind = profile->Name();
    if (kind == "participant") take_durations(*profile, name, duration_fields(dds::DomainParticipantQos{}), into);
    if (kind == "data_writer") take_durations(*profile, name, duration_fields(dds::DataWriterQos{}), into);
    if (kind == "data_reader") take_durations(*profile, name, duration_fields(dds::DataReaderQos{}), into);
  }
}

using eprosima::fastrtps::types::ReturnCode_t;
using eprosima::fastrtps::xmlparser::XMLProfileManager;

/// Returns the first invalid profile of a file with the library's message. The library's message for a whole file does
/// not name the profile, so this loads each profile alone, together with the transports.
std::string first_broken_profile(const std::filesystem::path& file, LogCapture& log) {
  tinyxml2::XMLDocument whole;
  if (whole.LoadFile(file.c_str()) != tinyxml2::XML_SUCCESS) return whole.ErrorStr();
  const auto* root = whole.FirstChildElement("dds");
  const auto* profiles = root != nullptr ? root->FirstChildElement("profiles") : nullptr;
  if (profiles == nullptr) return "expected <dds> with <profiles>";
  const auto* transports = profiles->FirstChildElement("transport_descriptors");
  for (const auto* profile = profiles->FirstChildElement(); profile; profile = profile->NextSiblingElement()) {
    tinyxml2::XMLDocument alone;
    auto* into = alone.InsertEndChild(root->ShallowClone(&alone))->InsertEndChild(profiles->ShallowClone(&alone));
    if (transports != nullptr && profile != transports) into->InsertEndChild(transports->DeepClone(&alone));
    into->InsertEndChild(profile->DeepClone(&alone));
    tinyxml2::XMLPrinter text;
    alone.Print(&text);
    XMLProfileManager::DeleteInstance();
    dds::DomainParticipantFactory::get_instance()->load_XML_profiles_string(text.CStr(), std::strlen(text.CStr()));
    const std::string complaints = log.take();
    if (complaints.empty()) continue;
    const char* name = profile->Attribute("profile_name");
    return (name != nullptr ? "profile '" + std::string{name} + "'" : "<" + std::string{profile->Name()} + ">") + ": " +
           complaints;
  }
  return "each profile alone is valid";
}

}  // namespace

template <class Qos>
void Durations::apply_to(const std::string& profile, Qos& qos) const {
  const auto found = by_profile_.find(profile);
  if (found == by_profile_.end()) return;
  for (const auto& field : duration_fields(qos))
    if (const auto value = found->second.find(field.element); value != found->second.end())
      field.in(qos) = value->second;
}
void Durations::apply(const std::string& profile, dds::DomainParticipantQos& qos) const { apply_to(profile, qos); }
void Durations::apply(const std::string& profile, dds::DataWriterQos& qos) const { apply_to(profile, qos); }
void Durations::apply(const std::string& profile, dds::DataReaderQos& qos) const { apply_to(profile, qos); }

Durations load_profiles(const std::filesystem::path& directory, LogCapture& log) {
  Durations durations;
  std::error_code error;
  if (!std::filesystem::is_directory(directory, error)) {
    throw WireError("qos directory '" + directory.string() +
                    "' does not exist; expected one with session.xml, probe.xml, bulk.xml and flow.yaml");
  }
  // With its first participant, the library would load a profile file that the environment names. So load that file now
  // and delete the table.
  auto* factory = dds::DomainParticipantFactory::get_instance();
  factory->load_profiles();
  XMLProfileManager::DeleteInstance();
  static_cast<void>(log.take());
  for (const char* name : kClassNames) {
    const auto file = directory / (std::string{name} + ".xml");
    if (!std::filesystem::is_regular_file(file, error)) {
      throw WireError(file.string() + ": no such file; expected the profiles of traffic class " + name);
    }
    tinyxml2::XMLDocument document;
    auto code = ReturnCode_t{ReturnCode_t::RETCODE_ERROR};
    if (document.LoadFile(file.c_str()) == tinyxml2::XML_SUCCESS) {
      take_durations(document, durations);
      tinyxml2::XMLPrinter text{nullptr, true};
      document.Print(&text);
      code = factory->load_XML_profiles_string(text.CStr(), std::strlen(text.CStr()));
    }
    const std::string complaints = log.take();
    if (code == ReturnCode_t::RETCODE_OK && complaints.empty()) continue;
    throw WireError(file.string() + ": " + first_broken_profile(file, log));
  }
  return durations;
}

}  // namespace tactus::wire
