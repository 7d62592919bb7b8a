/// The keys of a program: DDS Security for its participants, and the checks that the library does not make.
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "keys/member.hpp"
#include "wire/address/address.hpp"
#include "wire/audit.hpp"
#include "wire/library.hpp"
#include "wire/members.hpp"
#include "wire/sent_keys.hpp"

namespace tactus::wire {

/// The handshake between two participants needs messages of some 5 KB, and cannot divide them. So the messages of a
/// secured participant are larger than a frame, and the network divides them.
inline constexpr std::uint32_t kSecuredMessageBytes = 16384;

/// Bytes that protection adds to a message with one sample: 56 for encryption, and 20 for the proof of its origin to
/// each reader. Enough for two readers, an HRTC and a recorder.
inline constexpr std::uint32_t kProtectionBytes = 56 + 2 * 20;

/// Reads the keys that an address names, and completes the name of the program (Naming). Throws WireError if the keys
/// cannot be used now, or if they are those of another name.
[[nodiscard]] keys::Member read_keys(SessionAddress& address);
/// Returns whether the keys of a member permit this user or, for a host, this object.
[[nodiscard]] bool permits(const keys::Member& member, const std::string& name);
/// Throws WireError unless `permits`. `kind`: "user" or "object", for the message.
void expect_permitted(const keys::Member& member, const char* kind, const std::string& name);

/// Must outlive the participants. Has a thread, which writes the audit log, checks the certificates of all members
/// again and frees sent keys. Threads: any.
class Security final : public ParticipantListener {
 public:
  /// A certificate is cut off at most this time after the new list of revoked ones is there, or after it has expired.
  /// Its participants are gone after their lease of 4 s.
  static constexpr std::chrono::seconds kCheckInterval{5};

  /// Throws WireError like read_keys, and if the audit log cannot be written.
  explicit Security(SessionAddress& address);
  ~Security() override;
  Security(const Security&) = delete;
  Security& operator=(const Security&) = delete;

  /// Lets a participant use the keys: only members of the authority match, and samples and discovery of endpoints are
  /// encrypted.
  void apply(dds::DomainParticipantQos& qos) const;

  /// Returns whether the library may read a message that came from this address. Writes refusals to the audit log.
  [[nodiscard]] bool admits(const std::uint8_t* message, std::uint32_t size, const rtps::Locator_t& from) noexcept;

  /// Returns Members::removed; empty if memory runs out.
  [[nodiscard]] std::vector<GuidPrefix> removed() const noexcept;
  /// Calls Members::on_removed_by.
  void on_removed_by(const GuidPrefix& participant) noexcept;

  /// Reports to the members that the library reads an announcement. `message`: one that `admits` has let pass.
  void on_announcement(const std::uint8_t* message) noexcept;

  [[nodiscard]] const keys::Member& member() const noexcept { return member_; }
  [[nodiscard]] std::string who() const;  ///< role and 'name', for messages
  [[nodiscard]] Members& members() noexcept { return members_; }
  [[nodiscard]] SentKeys& sent_keys() noexcept { return sent_keys_; }

 private:
  void onParticipantAuthentication(dds::DomainParticipant*, rtps::ParticipantAuthenticationInfo&& info) override;
  void on_present(const rtps::GUID_t&, const std::vector<rtps::Locator_t>&) override {}
  void on_gone(const rtps::GUID_t& participant) override;
  void watch();

  const std::filesystem::path folder_;
  const keys::Member member_;
  const std::string identity_;  // as announced
  AuditLog audit_;
  Members members_;
  SentKeys sent_keys_;
  std::mutex mutex_;  // for `is_ending_`
  std::condition_variable ending_;
  bool is_ending_ = false;
  std::thread thread_;
};

}  // namespace tactus::wire
