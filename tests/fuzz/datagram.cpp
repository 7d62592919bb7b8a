/// A datagram from the network, as the transport reads it before DDS.
#include <string>

#include "keys/identity.hpp"
#include "tests/fuzz/target.hpp"
#include "wire/transport/announcements.hpp"
#include "wire/transport/protection.hpp"
#include "wire/transport/rtps_message.hpp"
#include "wire/transport/trimming.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace tactus;
  if (size < wire::kRtpsHeader) return 0;
  const auto bytes = static_cast<std::uint32_t>(size);
  wire::Announcements announcements{"tactus_bulk_reader"};
  wire::TrimmedMessage trimmed;
  (void)announcements.on_received(data, bytes);
  (void)wire::Announcements::sequence_of(data, bytes);
  (void)wire::refusal_of(data, bytes);
  (void)wire::trim(data, bytes, trimmed);
  (void)wire::size_without_statistics(data, bytes);
  (void)keys::read_identity(
      std::string{reinterpret_cast<const char*>(data) + wire::kRtpsHeader, size - wire::kRtpsHeader});
  return 0;
}
