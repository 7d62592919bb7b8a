#include "wire/profiles.hpp"

#include <fastrtps/xmlparser/XMLProfileManager.h>
#include <tinyxml2.h>

#include <cstring>
#include <string>
#include <system_error>

#include "wire/dds.hpp"

namespace tactus::wire {
namespace {

using eprosima::fastrtps::types::ReturnCode_t;
using eprosima::fastrtps::xmlparser::XMLProfileManager;

/// The library says what is wrong with a file, not in which profile: offers it each profile alone, with the transports.
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
  return "no profile is broken alone";
}

}  // namespace

void load_profiles(const std::filesystem::path& directory, LogCapture& log) {
  std::error_code error;
  if (!std::filesystem::is_directory(directory, error)) {
    throw WireError("qos directory '" + directory.string() +
                    "' does not exist; expected one with session.xml, probe.xml, bulk.xml and flow.yaml");
  }
  // The library reads a file that the environment names with its first participant: let it, then forget what it read.
  auto* factory = dds::DomainParticipantFactory::get_instance();
  factory->load_profiles();
  XMLProfileManager::DeleteInstance();
  static_cast<void>(log.take());
  for (const char* name : kClassNames) {
    const auto file = directory / (std::string{name} + ".xml");
    if (!std::filesystem::is_regular_file(file, error)) {
      throw WireError(file.string() + ": no such file; expected the profiles of traffic class " + name);
    }
    const auto code = factory->load_XML_profiles_file(file.string());
    const std::string complaints = log.take();
    if (code == ReturnCode_t::RETCODE_OK && complaints.empty()) continue;
    throw WireError(file.string() + ": " + first_broken_profile(file, log));
  }
}

}  // namespace tactus::wire
