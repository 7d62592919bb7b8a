/// Loads XML profiles whose elements have the names of Fast DDS 2.9, with either version of the library. The two versions
/// name five durations differently.
#pragma once

#include <tinyxml2.h>

namespace tactus::wire {

/// Adds the profiles of a document to the table that Fast DDS has for the whole process; false if the library
/// refuses them. Gives the elements of the document the names of the library's version.
[[nodiscard]] bool add_profiles(tinyxml2::XMLDocument& document);

}  // namespace tactus::wire
