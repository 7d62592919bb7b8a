#include "wire/profiles.hpp"

#include <tinyxml2.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <system_error>
#include <vector>

#include "wire/profile_elements.hpp"

namespace tactus::wire {
namespace {

using Duration = LibraryDuration;

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
      {"times/initialHeartbeatDelay", [](Qos& q) -> Duration& { return initial_heartbeat_delay(q); }},
      {"times/heartbeatPeriod", [](Qos& q) -> Duration& { return heartbeat_period(q); }},
      {"times/nackResponseDelay", [](Qos& q) -> Duration& { return nack_response_delay(q); }}};
  return all;
}
const std::vector<DurationField<dds::DataReaderQos>>& duration_fields(const dds::DataReaderQos&) {
  using Qos = dds::DataReaderQos;
  static const std::vector<DurationField<Qos>> all{
      {"times/initialAcknackDelay", [](Qos& q) -> Duration& { return initial_acknack_delay(q); }},
      {"times/heartbeatResponseDelay", [](Qos& q) -> Duration& { return heartbeat_response_delay(q); }}};
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
                    const std::vector<DurationField<Qos>>& duration_fields, Profiles& into) {
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
void take_durations(tinyxml2::XMLDocument& document, Profiles& into) {
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

/// Adds `suffix` to the names of profiles and transports, and to the names by which profiles refer to transports.
void add_suffix(tinyxml2::XMLElement& element, const std::string& suffix) {
  if (const char* const name = element.Attribute("profile_name"))
    element.SetAttribute("profile_name", (name + suffix).c_str());
  if (std::strcmp(element.Name(), "transport_id") == 0 && element.GetText() != nullptr)
    element.SetText((element.GetText() + suffix).c_str());
  for (auto* child = element.FirstChildElement(); child != nullptr; child = child->NextSiblingElement())
    add_suffix(*child, suffix);
}

/// A suffix that no profile of this process has.
std::string new_suffix() {
  static int count = 0;
  return "#" + std::to_string(++count);
}

bool load(tinyxml2::XMLDocument& document, const std::string& suffix) {
  if (document.RootElement() != nullptr) add_suffix(*document.RootElement(), suffix);
  return add_profiles(document);
}

/// The library's messages, with the names of the file.
std::string take_without(const std::string& suffix, LogCapture& log) {
  std::string text = log.take();
  for (std::size_t at = text.find(suffix); at != std::string::npos; at = text.find(suffix, at))
    text.erase(at, suffix.size());
  return text;
}

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
    const std::string suffix = new_suffix();
    (void)load(alone, suffix);
    const std::string complaints = take_without(suffix, log);
    if (complaints.empty()) continue;
    const char* name = profile->Attribute("profile_name");
    return (name != nullptr ? "profile '" + std::string{name} + "'" : "<" + std::string{profile->Name()} + ">") + ": " +
           complaints;
  }
  return "each profile alone is valid";
}

std::filesystem::path profile_file(const std::filesystem::path& directory, std::size_t traffic) {
  return directory / (std::string{kClassNames[traffic]} + ".xml");
}

}  // namespace

template <class Qos>
void Profiles::apply_durations(const std::string& profile, Qos& qos) const {
  const auto found = durations_.find(profile);
  if (found == durations_.end()) return;
  for (const auto& field : duration_fields(qos))
    if (const auto value = found->second.find(field.element); value != found->second.end())
      field.in(qos) = value->second;
}
bool Profiles::read(dds::DomainParticipantFactory& factory, const std::string& profile,
                    dds::DomainParticipantQos& qos) const {
  if (!succeeded(factory.get_participant_qos_from_profile(profile + suffix_, qos))) return false;
  apply_durations(profile, qos);
  return true;
}
bool Profiles::read(dds::Publisher& publisher, const std::string& profile, dds::DataWriterQos& qos) const {
  if (!succeeded(publisher.get_datawriter_qos_from_profile(profile + suffix_, qos))) return false;
  apply_durations(profile, qos);
  return true;
}
bool Profiles::read(dds::Subscriber& subscriber, const std::string& profile, dds::DataReaderQos& qos) const {
  if (!succeeded(subscriber.get_datareader_qos_from_profile(profile + suffix_, qos))) return false;
  apply_durations(profile, qos);
  return true;
}

Profiles load_profiles(const std::filesystem::path& directory, LogCapture& log) {
  std::error_code error;
  if (!std::filesystem::is_directory(directory, error)) {
    throw WireError("qos directory '" + directory.string() +
                    "' does not exist; expected one with session.xml, probe.xml, bulk.xml and flow.yaml");
  }
  std::array<tinyxml2::XMLDocument, kTrafficClasses> documents;
  std::string texts;
  for (std::size_t i = 0; i < kTrafficClasses; ++i) {
    const auto file = profile_file(directory, i);
    if (!std::filesystem::is_regular_file(file, error)) {
      throw WireError(file.string() + ": no such file; expected the profiles of traffic class " + kClassNames[i]);
    }
    if (documents[i].LoadFile(file.c_str()) != tinyxml2::XML_SUCCESS)
      throw WireError(file.string() + ": " + documents[i].ErrorStr());
    tinyxml2::XMLPrinter text{nullptr, true};
    documents[i].Print(&text);
    texts += text.CStr();
  }
  static std::map<std::string, Profiles> loaded;  // by the texts
  if (const auto found = loaded.find(texts); found != loaded.end()) return found->second;

  Profiles profiles{new_suffix()};
  static_cast<void>(log.take());
  for (std::size_t i = 0; i < kTrafficClasses; ++i) {
    take_durations(documents[i], profiles);
    const bool is_loaded = load(documents[i], profiles.suffix());
    const std::string complaints = log.take();
    if (is_loaded && complaints.empty()) continue;
    const auto file = profile_file(directory, i);
    throw WireError(file.string() + ": " + first_broken_profile(file, log));
  }
  loaded.emplace(texts, profiles);
  return profiles;
}

}  // namespace tactus::wire
