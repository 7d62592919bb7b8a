/// The keys of the programs of a secured session, which a benchmark starts.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "keys/authority.hpp"
#include "wire/participants.hpp"

namespace tactus::bench {

/// Makes the keys of a member when they are needed first. One thread at a time.
class SessionKeys {
 public:
  /// `folder`: for the keys and the audit logs of all members; must exist.
  explicit SessionKeys(const std::filesystem::path& folder)
      : folder_{folder}, authority_{keys::Authority::create(folder / "bench-keys")} {}

  /// Returns the options --keys and --audit of the program tactus-`kind`.
  [[nodiscard]] std::vector<std::string> arguments(const std::string& kind, const std::string& member) const {
    const keys::Role role =
        kind == "host" ? keys::Role::kHost : (kind == "hrtc" ? keys::Role::kHrtc : keys::Role::kObserver);
    return {"--keys", keys_of(member, role).string(), "--audit", audit_log_of(member).string()};
  }
  /// Gives the address the keys of an observer.
  void secure(wire::SessionAddress& address) const {
    address.keys = keys_of(address.participant, keys::Role::kObserver);
    address.audit = audit_log_of(address.participant);
  }

 private:
  [[nodiscard]] std::filesystem::path keys_of(const std::string& member, keys::Role role) const {
    keys::NewMember added;
    added.name = member;
    added.role = role;
    std::filesystem::path made = authority_.folder_of(member);
    return std::filesystem::exists(made) ? made : authority_.add(added);
  }
  [[nodiscard]] std::filesystem::path audit_log_of(const std::string& member) const {
    return folder_ / (member + ".jsonl");
  }

  std::filesystem::path folder_;
  keys::Authority authority_;
};

}  // namespace tactus::bench
