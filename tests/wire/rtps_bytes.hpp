/// Makes RTPS messages byte by byte, as an attacker or the library would send them.
#pragma once

#include <cstdint>
#include <vector>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire::test {

using Bytes = std::vector<std::uint8_t>;

/// A little-endian submessage that states its length.
inline Bytes submessage(std::uint8_t id, const Bytes& body, std::uint8_t flags = 1) {
  Bytes made{id, flags, static_cast<std::uint8_t>(body.size()), static_cast<std::uint8_t>(body.size() >> 8u)};
  made.insert(made.end(), body.begin(), body.end());
  return made;
}

/// A sample of `writer` for every reader; `payload` with its encapsulation header. Without payload, the sample states that
/// an instance has ended.
inline Bytes data(const Bytes& writer, std::uint32_t sequence, const Bytes& payload) {
  Bytes body{0, 0, 16, 0, 0, 0, 0, 0};
  body.insert(body.end(), writer.begin(), writer.end());
  for (const std::uint32_t half : {0u, sequence})
    for (unsigned shift = 0; shift < 32; shift += 8) body.push_back(static_cast<std::uint8_t>(half >> shift));
  body.insert(body.end(), payload.begin(), payload.end());
  return submessage(kDataId, body, payload.empty() ? 0x01 : 0x05);
}

inline Bytes message_of(const std::vector<Bytes>& parts,
                        const GuidPrefix& sender = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}) {
  Bytes made{'R', 'T', 'P', 'S', 2, 2, 1, 15};
  made.insert(made.end(), sender.begin(), sender.end());
  for (const Bytes& part : parts) made.insert(made.end(), part.begin(), part.end());
  return made;
}

inline const Bytes kInfoDestination = submessage(kInfoDestinationId, Bytes(12, 9));
inline const Bytes kInfoTime = submessage(kInfoTimeId, Bytes(8, 0));

}  // namespace tactus::wire::test
