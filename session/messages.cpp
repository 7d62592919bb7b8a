#include "session/messages.hpp"

#include <xxhash.h>

namespace tactus::session {

std::uint64_t id_of(const std::string& name) noexcept { return XXH3_64bits(name.data(), name.size()); }

}  // namespace tactus::session
