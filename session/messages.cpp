#include "session/messages.hpp"

#include <xxhash.h>

#include <array>

namespace tactus::session {

std::uint64_t id_of(const std::string& name) noexcept { return XXH3_64bits(name.data(), name.size()); }

std::uint64_t stream_id(const Origin& host, const Origin& hrtc, std::uint64_t object_id) noexcept {
  const std::array<std::uint64_t, 6> names{host.session,     host.participant, host.incarnation,
                                           hrtc.participant, hrtc.incarnation, object_id};
  return XXH3_64bits(names.data(), sizeof names);
}

std::uint32_t checksum_of(spm::Span<const std::uint8_t> payload) noexcept {
  return static_cast<std::uint32_t>(XXH3_64bits(payload.data(), payload.size()));
}

}  // namespace tactus::session
