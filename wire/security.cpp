#include "wire/security.hpp"

#include <ctime>
#include <string>

#include "wire/error.hpp"

namespace tactus::wire {

keys::Member read_keys(const std::filesystem::path& folder) {
  try {
    return keys::read_member(folder, std::time(nullptr));
  } catch (const keys::KeyError& error) {
    throw WireError(std::string{"--keys: "} + error.what());
  }
}

void secure(const std::filesystem::path& folder, dds::DomainParticipantQos& qos) {
  auto& properties = qos.properties().properties();
  const auto add = [&](const char* name, const std::string& value) { properties.emplace_back(name, value); };
  const auto add_file = [&](const std::string& name, const char* file) {
    add(name.c_str(), "file://" + std::filesystem::absolute(folder / file).string());
  };
  using namespace keys::files;
  const std::string identity = "dds.sec.auth.builtin.PKI-DH.", access = "dds.sec.access.builtin.Access-Permissions.";
  add("dds.sec.auth.plugin", "builtin.PKI-DH");
  add_file(identity + "identity_ca", kIdentityCa);
  add_file(identity + "identity_certificate", kCertificate);
  add_file(identity + "private_key", kPrivateKey);
  add_file(identity + "identity_crl", kRevoked);
  add("dds.sec.access.plugin", "builtin.Access-Permissions");
  add_file(access + "permissions_ca", kPermissionsCa);
  add_file(access + "governance", kGovernance);
  add_file(access + "permissions", kPermissions);
  add("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
}

}  // namespace tactus::wire
