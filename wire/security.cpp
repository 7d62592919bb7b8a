#include "wire/security.hpp"

#include <algorithm>
#include <ctime>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "keys/identity.hpp"
#include "realtime/process.hpp"
#include "wire/dds.hpp"
#include "wire/error.hpp"
#include "wire/incarnation.hpp"
#include "wire/transport/protection.hpp"

namespace tactus::wire {
namespace {

keys::Member read_folder(const std::filesystem::path& folder) {
  try {
    return keys::read_member(folder, std::time(nullptr));
  } catch (const keys::KeyError& error) {
    throw WireError(std::string{"--keys: "} + error.what());
  }
}

std::string text_of(const keys::Member& member) { return std::string{name_of(member.role)} + " '" + member.name + "'"; }

std::filesystem::path audit_file(const SessionAddress& address) {
  std::filesystem::path file = address.audit;
  if (file.empty()) {
    const std::filesystem::path state = state_folder();
    if (state.empty()) throw WireError("--audit FILE is missing, because neither XDG_STATE_HOME nor HOME is set");
    file = state / "audit" / (address.session + "." + address.participant + ".jsonl");
  }
  std::error_code error;
  if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path(), error);
  return file;
}

/// Returns the event of the audit log; null for messages that the library of a member sends too.
const char* event_of(Refusal refusal) {
  switch (refusal) {
    case Refusal::kNone:
    case Refusal::kControl:
    case Refusal::kLeave:
      break;
    case Refusal::kPlain:
      return "plain message";
    case Refusal::kNoOrigin:
      return "message without proof of origin";
    case Refusal::kOther:
      return "authentication of another participant";
    case Refusal::kMalformed:
      return "malformed message";
  }
  return nullptr;
}

}  // namespace

keys::Member read_keys(SessionAddress& address) {
  keys::Member member = read_folder(address.keys);
  if (address.naming == Naming::kInstance) {
    address.participant = keys::instance_name(member.name, address.participant);
    address.naming = Naming::kGiven;
  }
  if (!keys::is_name_of(address.participant, member.name))
    throw WireError("the name of this program is '" + address.participant + "', but its keys are those of " +
                    text_of(member) + "; expected --name " + member.name);
  if (!keys::read_identity(text_of(keys::identity_of(member, address.participant))))
    throw WireError("the name of this program is '" + address.participant +
                    "'; with keys, expected at most 63 letters, digits, hyphens, underscores and points");
  return member;
}

bool permits(const keys::Member& member, const std::string& name) {
  const keys::Permitted& permitted = member.permitted;
  return permitted.empty() || std::find(permitted.begin(), permitted.end(), name) != permitted.end();
}

void expect_permitted(const keys::Member& member, const char* kind, const std::string& name) {
  if (permits(member, name)) return;
  throw WireError(std::string{kind} + " '" + name + "': the keys of " + text_of(member) + " permit only " +
                  keys::text_of(member.permitted) + "; see docs/how-to/secure.md");
}

Security::Security(SessionAddress& address)
    : folder_{address.keys},
      member_{read_keys(address)},
      identity_{text_of(keys::identity_of(member_, address.participant))},
      audit_{audit_file(address), address.session, address.participant},
      members_{folder_, member_, address.participant, audit_} {
  audit_.add({"started", std::string{name_of(member_.role)} + " " + member_.name, "", ""});
  if (const std::string error = audit_.write(realtime::monotonic_ns()); !error.empty())
    throw WireError("audit log: " + error + "; --audit FILE names another file");
  thread_ = std::thread{[this] { watch(); }};
}

Security::~Security() {
  {
    const std::lock_guard<std::mutex> lock{mutex_};
    is_ending_ = true;
  }
  ending_.notify_all();
  thread_.join();
}

std::string Security::who() const { return text_of(member_); }

bool Security::admits(const std::uint8_t* message, std::uint32_t size, const rtps::Locator_t& from) noexcept try {
  const auto address = [&] { return rtps::IPLocator::toIPv4string(from); };
  const Refusal refusal = refusal_of(message, size);
  if (refusal == Refusal::kNone) return members_.admits(message, size, address);
  if (const char* const event = event_of(refusal)) audit_.add({event, "", address(), ""});
  return false;
} catch (...) {  // out of memory, or OpenSSL failed
  return false;
}

std::vector<GuidPrefix> Security::removed() const noexcept try {
  return members_.removed();
} catch (...) {  // out of memory
  return {};
}

void Security::on_removed_by(const GuidPrefix& participant) noexcept try {
  members_.on_removed_by(participant);
} catch (...) {  // out of memory: the next announcement states it again
}

void Security::on_announcement(const std::uint8_t* message) noexcept try {
  members_.on_announcement(sender_of(message));
} catch (...) {  // out of memory: the audit log lacks an event
}

void Security::apply(dds::DomainParticipantQos& qos) const {
  auto& properties = qos.properties().properties();
  const auto add = [&](const char* name, const std::string& value) { properties.emplace_back(name, value); };
  const auto add_file = [&](const std::string& name, const char* file) {
    add(name.c_str(), "file://" + std::filesystem::absolute(folder_ / file).string());
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
  qos.user_data().data_vec({identity_.begin(), identity_.end()});
}

void Security::onParticipantAuthentication(dds::DomainParticipant*, rtps::ParticipantAuthenticationInfo&& info) try {
  members_.on_authentication(prefix_of(info.guid),
                             info.status == rtps::ParticipantAuthenticationInfo::AUTHORIZED_PARTICIPANT);
} catch (...) {  // out of memory: the audit log lacks an event
}

void Security::on_gone(const rtps::GUID_t& participant) try {
  members_.on_gone(prefix_of(participant));
} catch (...) {  // out of memory
}

/// Writes the audit log and frees sent keys twice a second, and checks certificates every kCheckInterval.
void Security::watch() {
  constexpr std::chrono::milliseconds kWriteInterval{500};
  auto next_check = std::chrono::steady_clock::now() + kCheckInterval;
  std::unique_lock<std::mutex> lock{mutex_};
  for (bool is_last = false; !is_last;) {
    is_last = ending_.wait_for(lock, kWriteInterval, [this] { return is_ending_; });
    lock.unlock();
    try {
      sent_keys_.free_acknowledged();
      if (std::chrono::steady_clock::now() >= next_check) {
        next_check += kCheckInterval;
        for (const std::string& text : members_.check_again(std::time(nullptr))) report(text);
      }
      if (const std::string error = audit_.write(realtime::monotonic_ns(), is_last); !error.empty())
        report("audit log: " + error);
    } catch (const std::exception& error) {  // the next time may succeed
      report(std::string{"checks of keys: "} + error.what());
    }
    lock.lock();
  }
}

}  // namespace tactus::wire
