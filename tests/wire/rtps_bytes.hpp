/// Makes RTPS messages byte by byte, as an attacker or the library would send them.
#pragma once

#include <cstdint>
#include <string>
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

/// The payload of a message of the authentication from `source`, with the two properties of a handshake that state who
/// begins it. `participant`: a parameter list.
inline Bytes handshake(const Bytes& source, const Bytes& certificate, const Bytes& participant) {
  Bytes made{0, 1, 0, 0};
  made.insert(made.end(), source.begin(), source.end());
  made.resize(4 + 96);
  const auto add_number = [&](std::size_t number) {
    for (unsigned shift = 0; shift < 32; shift += 8) made.push_back(static_cast<std::uint8_t>(number >> shift));
  };
  const auto add_property = [&](const std::string& name, const Bytes& value) {
    add_number(name.size() + 1);
    made.insert(made.end(), name.begin(), name.end());
    made.resize((made.size() + 4) / 4 * 4);
    add_number(value.size());
    made.insert(made.end(), value.begin(), value.end());
    made.resize((made.size() + 3) / 4 * 4);
  };
  add_property("c.id", certificate);
  add_property("c.pdata", participant);
  return made;
}

inline const Bytes kInfoDestination = submessage(kInfoDestinationId, Bytes(12, 9));
inline const Bytes kInfoTime = submessage(kInfoTimeId, Bytes(8, 0));

}  // namespace tactus::wire::test
