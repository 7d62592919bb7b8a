/// A datagram from the network, as the transport reads it before DDS.
#include <string>

#include "keys/authority.hpp"
#include "keys/identity.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/temporary_folder.hpp"
#include "wire/members.hpp"
#include "wire/transport/announcements.hpp"
#include "wire/transport/protection.hpp"
#include "wire/transport/rtps_message.hpp"
#include "wire/transport/trimming.hpp"

namespace {

using namespace tactus;

/// The members of a session with an authority of its own.
wire::Members& members() {
  static const test_support::TemporaryFolder folder;
  static const keys::Authority authority = keys::Authority::create(folder.path() / "lab-keys");
  static const std::filesystem::path keys_of_desk = [] {
    keys::NewMember desk;
    desk.name = "desk";
    desk.role = keys::Role::kHrtc;
    return authority.add(desk);
  }();
  static wire::AuditLog audit{folder.path() / "audit.jsonl", "lab", "desk"};
  static wire::Members all{keys_of_desk, keys::read_member(keys_of_desk, std::time(nullptr)), "desk", audit};
  return all;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < wire::kRtpsHeader) return 0;
  const auto bytes = static_cast<std::uint32_t>(size);
  wire::Announcements announcements{"tactus_bulk_reader"};
  wire::TrimmedMessage trimmed;
  (void)announcements.on_received(data, bytes);
  (void)wire::Announcements::sequence_of(data, bytes);
  if (wire::refusal_of(data, bytes) == wire::Refusal::kNone)
    (void)members().admits(data, bytes, [] { return std::string{"10.0.0.9"}; });
  (void)wire::trim(data, bytes, trimmed);
  (void)wire::size_without_statistics(data, bytes);
  (void)keys::read_identity(
      std::string{reinterpret_cast<const char*>(data) + wire::kRtpsHeader, size - wire::kRtpsHeader});
  return 0;
}
