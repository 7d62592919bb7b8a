/// The documents of DDS Security 1.1 that say what members may do, as XML.
#pragma once

#include <ctime>
#include <string>
#include <string_view>
#include <vector>

#include "keys/member.hpp"

namespace tactus::keys {

/// A topic that members of some roles may write.
struct WriteRight {
  const char* topic;
  bool of_user;  ///< only in the partitions of the member's users
};
/// Returns the topics that a role may write. Every member may read all topics.
[[nodiscard]] std::vector<WriteRight> rights_of(Role role);
/// Returns the roles that may write a topic, other than kTester.
[[nodiscard]] std::vector<Role> writers_of(std::string_view topic);

/// Returns the rules of a secured session: only members join, and every submessage of discovery and of samples is
/// encrypted, with a proof of its origin for each receiver. Fast DDS accepts whole messages without such a proof, and
/// nobody can see inside an encrypted message whether its submessages name another sender, so messages are not
/// encrypted as a whole.
[[nodiscard]] std::string governance_document();

/// Returns what one member may do. `subject`: name of the certificate's subject, as RFC 2253 writes it.
[[nodiscard]] std::string permissions_document(const std::string& subject, Role role,
                                               const std::vector<std::string>& users, std::time_t valid_from,
                                               std::time_t valid_until);

/// Returns whether permissions are those of this subject.
[[nodiscard]] bool is_for(const std::string& permissions, const std::string& subject);

}  // namespace tactus::keys
