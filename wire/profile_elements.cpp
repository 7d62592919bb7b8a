#include "wire/profile_elements.hpp"

#include <cstring>

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

void set_text(Element& parent, const char* name, const char* text) {
  if (text != nullptr) parent.InsertNewChildElement(name)->SetText(text);
}

/// Replaces `throughputController` of a writer by `flow_controller_descriptor` of each participant, which the writer names.
void replace_rate_limit(Element& profiles, Element& writer) {
  Element* const old = writer.FirstChildElement("throughputController");
  const char* const name = writer.Attribute("profile_name");
  if (old == nullptr || name == nullptr) return;
  const auto text_of = [&](const char* element) {
    const Element* const found = old->FirstChildElement(element);
    return found != nullptr ? found->GetText() : nullptr;
  };
  for (auto* participant = profiles.FirstChildElement("participant"); participant != nullptr;
       participant = participant->NextSiblingElement("participant")) {
    Element* rtps = participant->FirstChildElement("rtps");
    if (rtps == nullptr) rtps = participant->InsertNewChildElement("rtps");
    Element* list = rtps->FirstChildElement("flow_controller_descriptor_list");
    if (list == nullptr) list = rtps->InsertNewChildElement("flow_controller_descriptor_list");
    Element* const limit = list->InsertNewChildElement("flow_controller_descriptor");
    set_text(*limit, "name", name);
    set_text(*limit, "max_bytes_per_period", text_of("bytesPerPeriod"));
    set_text(*limit, "period_ms", text_of("periodMillisecs"));
  }
  Element* qos = writer.FirstChildElement("qos");
  if (qos == nullptr) qos = writer.InsertNewChildElement("qos");
  Element* mode = qos->FirstChildElement("publishMode");
  if (mode == nullptr) mode = qos->InsertNewChildElement("publishMode");
  set_text(*mode, "flow_controller_name", name);
  writer.DeleteChild(old);
}

void use_names_of_library(tinyxml2::XMLDocument& document) {
  Element* const root = document.FirstChildElement("dds");
  Element* const profiles = root != nullptr ? root->FirstChildElement("profiles") : nullptr;
  if (profiles == nullptr) return;
  for (auto* profile = profiles->FirstChildElement(); profile != nullptr; profile = profile->NextSiblingElement()) {
    rename_durations(*profile);
    if (std::strcmp(profile->Name(), "data_writer") == 0) replace_rate_limit(*profiles, *profile);
  }
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
