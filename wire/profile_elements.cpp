#include "wire/profile_elements.hpp"

#include <cstring>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>

#include "wire/library.hpp"

namespace tactus::wire {
namespace {

#ifdef TACTUS_FAST_DDS_3
using Element = tinyxml2::XMLElement;

constexpr std::array<std::pair<const char*, const char*>, 5> kDurations{
    {{"initialHeartbeatDelay", "initial_heartbeat_delay"},
     {"heartbeatPeriod", "heartbeat_period"},
     {"nackResponseDelay", "nack_response_delay"},
     {"initialAcknackDelay", "initial_acknack_delay"},
     {"heartbeatResponseDelay", "heartbeat_response_delay"}}};

void rename_durations(Element& profile) {
  Element* const times = profile.FirstChildElement("times");
  if (times == nullptr) return;
  for (auto* time = times->FirstChildElement(); time != nullptr; time = time->NextSiblingElement())
    for (const auto& [name, new_name] : kDurations)
      if (std::strcmp(time->Name(), name) == 0) {
        time->SetName(new_name);
        break;
      }
}

void use_names_of_library(tinyxml2::XMLDocument& document) {
  Element* const root = document.FirstChildElement("dds");
  Element* const profiles = root != nullptr ? root->FirstChildElement("profiles") : nullptr;
  if (profiles == nullptr) return;
  for (auto* profile = profiles->FirstChildElement(); profile != nullptr; profile = profile->NextSiblingElement())
    rename_durations(*profile);
}
#else
void use_names_of_library(tinyxml2::XMLDocument&) {}
#endif

}  // namespace

bool add_profiles(tinyxml2::XMLDocument& document) {
  use_names_of_library(document);
  tinyxml2::XMLPrinter text{nullptr, true};
  document.Print(&text);
  auto* const factory = dds::DomainParticipantFactory::get_instance();
  return succeeded(factory->load_XML_profiles_string(text.CStr(), std::strlen(text.CStr())));
}

}  // namespace tactus::wire
