#include "wire/footprint.hpp"

#include <tinyxml2.h>

#include <algorithm>

#include "wire/error.hpp"
#include "wire/library.hpp"

namespace tactus::wire {

Footprint read_footprint(const std::filesystem::path& qos) {
  Footprint max;
  for (const char* traffic : {"session", "probe", "bulk"}) {
    const std::filesystem::path file = qos / (std::string{traffic} + ".xml");
    tinyxml2::XMLDocument document;
    if (document.LoadFile(file.c_str()) != tinyxml2::XML_SUCCESS)
      throw WireError(file.string() + ": is not readable XML: " + document.ErrorStr());
    const tinyxml2::XMLElement* at = document.RootElement();
    for (const char* name : {"profiles", "transport_descriptors", "transport_descriptor"}) {
      if (at != nullptr) at = at->FirstChildElement(name);
    }
    const auto raise = [&](int& bytes, const char* name) {
      const tinyxml2::XMLElement* const element = at != nullptr ? at->FirstChildElement(name) : nullptr;
      int value = 0;
      if (element == nullptr || element->QueryIntText(&value) != tinyxml2::XML_SUCCESS) {
        throw WireError(file.string() + ": no number of bytes in <" + name + "> of its transport_descriptor");
      }
      bytes = std::max(bytes, value);
    };
    raise(max.message, "maxMessageSize");
    raise(max.receive_buffer, "receiveBufferSize");
    raise(max.send_buffer, "sendBufferSize");
  }
  return max;
}

std::string library_version() { return kLibraryVersion; }

}  // namespace tactus::wire
