#include "wire/members.hpp"

#include <algorithm>
#include <mutex>
#include <string_view>
#include <utility>

#include "keys/documents.hpp"
#include "realtime/process.hpp"
#include "session/messages.hpp"

namespace tactus::wire {
namespace {

constexpr std::uint32_t kUserData = 0x2c, kGuid = 0x50;  // parameters (RTPS 2.2, 9.6.2)
constexpr std::int64_t kSilentNs = 60'000'000'000;       // after which an unused participant makes room
constexpr std::array<std::uint8_t, 4> kAnnouncements{0x00, 0x01, 0x00, 0xc2};

std::string subject_of(const keys::Identity& identity) {
  return std::string{name_of(identity.role)} + " " + identity.name;
}

/// The begin of the GUIDs of all participants with one certificate.
keys::GuidBegin begin_of(const GuidPrefix& prefix) {
  keys::GuidBegin begin;
  std::copy_n(prefix.begin(), begin.size(), begin.begin());
  return begin;
}

bool may_write(keys::Role role, std::string_view topic) {
  static const auto topics_by_role = [] {
    std::map<keys::Role, std::vector<std::string_view>> topics;
    for (const keys::Role known : keys::kRoles)
      for (const keys::WriteRight& right : keys::rights_of(known)) topics[known].emplace_back(right.topic);
    return topics;
  }();
  const std::vector<std::string_view>& topics = topics_by_role.at(role);
  return std::find(topics.begin(), topics.end(), topic) != topics.end();
}

}  // namespace

Members::Members(std::filesystem::path folder, keys::Member self, AuditLog& audit)
    : folder_{std::move(folder)}, self_{std::move(self)}, audit_{audit}, revoked_{keys::read_revoked(folder_)} {}

bool Members::admits(const std::uint8_t* message, std::uint32_t size, const Address& from) {
  const GuidPrefix sender = sender_of(message);
  std::uint32_t at = kRtpsHeader;
  while (const std::optional<Submessage> found = submessage_at(message, size, at)) {
    const std::optional<RtpsData> data = data_of(*found);
    if (data && data->writer == kAnnouncements && !admits_announcement(data->payload, sender, from)) return false;
    if (found->last) break;
    at = found->next;
  }
  const std::shared_lock lock{mutex_};
  const auto known = certificates_.find(begin_of(sender));
  return known == certificates_.end() || !known->second.is_cut_off;
}

bool Members::admits_announcement(const RtpsBytes& payload, const GuidPrefix& sender, const Address& from) {
  std::optional<keys::Identity> identity;
  bool is_own_guid = false;
  ParameterList parameters = parameters_of(payload);
  while (const auto parameter = parameters.next()) {
    const RtpsBytes& value = parameter->value;
    if (parameter->id == kGuid && value.size >= sender.size())
      is_own_guid = std::equal(sender.begin(), sender.end(), value.at);
    if (parameter->id == kUserData && value.size >= 4) {
      const std::uint32_t length = std::min(value.number(0, 4), value.size - 4);
      identity = keys::read_identity({reinterpret_cast<const char*>(value.at) + 4, length});
    }
  }
  const std::int64_t now_ns = realtime::monotonic_ns();
  if (is_own_guid) {
    const std::unique_lock lock{mutex_};
    if (const auto known = participants_.find(sender); known != participants_.end()) {
      known->second.announced_ns = now_ns;
      return !certificates_.at(known->second.certificate).is_cut_off;
    }
  }
  if (!identity || !is_own_guid || keys::guid_begin_of(self_.group, *identity) != begin_of(sender)) {
    audit_.add({"unknown program", "", from(), identity ? "states to be " + subject_of(*identity) : ""});
    return false;
  }
  const std::unique_lock lock{mutex_};
  // Everyone can state an identity that fits to a GUID. So nothing is stored for those that are refused.
  if (const char* const why = reason_to_cut_off(*identity, begin_of(sender))) {
    audit_.add({"cut off", subject_of(*identity), from(), why});
    return false;
  }
  if (!make_room()) {
    audit_.add({"too many programs", "", from(), ""});
    return false;
  }
  certificates_.try_emplace(begin_of(sender),
                            Certificate{subject_of(*identity), identity->serial, identity->valid_until});
  participants_[sender] = {begin_of(sender), identity->role, session::id_of(identity->participant), now_ns};
  return true;
}

/// Returns why a certificate is refused; null if it is not.
const char* Members::reason_to_cut_off(const keys::Identity& identity, const keys::GuidBegin& begin) const {
  if (std::find(revoked_.begin(), revoked_.end(), identity.serial) != revoked_.end()) return "revoked";
  if (std::time(nullptr) > identity.valid_until) return "expired";
  const auto known = certificates_.find(begin);
  return known != certificates_.end() && known->second.is_cut_off ? "too many refused samples" : nullptr;
}

/// Forgets participants that have been silent for long, if there are too many.
bool Members::make_room() {
  if (participants_.size() < kMaxParticipants) return true;
  const std::int64_t oldest_ns = realtime::monotonic_ns() - kSilentNs;
  std::erase_if(participants_, [&](const auto& entry) { return entry.second.announced_ns < oldest_ns; });
  std::erase_if(certificates_, [&](const auto& certificate) {
    return !certificate.second.is_cut_off &&
           std::none_of(participants_.begin(), participants_.end(),
                        [&](const auto& entry) { return entry.second.certificate == certificate.first; });
  });
  return participants_.size() < kMaxParticipants;
}

void Members::cut_off(Certificate& certificate, const char* why) {
  certificate.is_cut_off = true;
  audit_.add({"cut off", certificate.subject, "", why});
}

bool Members::is_author(const GuidPrefix& participant, std::uint64_t claimed, const char* topic) {
  {
    const std::shared_lock lock{mutex_};
    const auto author = participants_.find(participant);
    if (author == participants_.end()) return false;  // it was not admitted, so the library cannot have matched it
    const bool is_true = claimed == 0 || author->second.id == claimed;
    if (is_true && may_write(author->second.role, topic))
      return !certificates_.at(author->second.certificate).is_cut_off;
  }
  const std::unique_lock lock{mutex_};
  const auto author = participants_.find(participant);
  if (author == participants_.end()) return false;
  Certificate& certificate = certificates_.at(author->second.certificate);
  audit_.add(
      {may_write(author->second.role, topic) ? "false sender" : "not permitted", certificate.subject, "", topic});
  if (++certificate.refused == kMaxRefused) cut_off(certificate, "too many refused samples");
  return false;
}

std::uint64_t Members::id_of(const GuidPrefix& participant) const {
  const std::shared_lock lock{mutex_};
  const auto known = participants_.find(participant);
  return known == participants_.end() ? 0 : known->second.id;
}

void Members::on_authentication(const GuidPrefix& participant, bool succeeded) {
  const std::shared_lock lock{mutex_};
  const auto known = certificates_.find(begin_of(participant));
  const std::string stated = known == certificates_.end() ? "" : known->second.subject;
  if (succeeded)
    audit_.add({"joined", stated, "", ""});
  else
    audit_.add({"not authenticated", "", "", stated.empty() ? "" : "states to be " + stated});
}

std::vector<std::string> Members::check_again(std::time_t now) {
  std::vector<std::string> reports;
  std::optional<std::vector<std::string>> list;
  try {
    list = keys::read_revoked(folder_);
  } catch (const keys::KeyError& error) {
    reports.push_back(std::string{error.what()} + "; the earlier list stays in force");
  }
  const std::unique_lock lock{mutex_};
  if (list) revoked_ = std::move(*list);
  const auto is_revoked = [&](const std::string& serial) {
    return std::find(revoked_.begin(), revoked_.end(), serial) != revoked_.end();
  };
  for (auto& [begin, certificate] : certificates_) {
    if (certificate.is_cut_off || (!is_revoked(certificate.serial) && now <= certificate.valid_until)) continue;
    cut_off(certificate, is_revoked(certificate.serial) ? "revoked" : "expired");
    reports.push_back("the keys of " + certificate.subject + " are " +
                      (is_revoked(certificate.serial) ? "revoked" : "expired") +
                      "; its messages are refused from now on");
  }
  if (is_revoked(self_.serial))
    reports.push_back("the keys of this program are revoked; other programs refuse its messages");
  else if (now > self_.valid_until)
    reports.push_back(
        "the keys of this program have expired; other programs refuse its messages. Make new ones with: " +
        std::string{"tactus keys add-"} + std::string{name_of(self_.role)} + " AUTHORITY " + self_.name + " --replace");
  return reports;
}

}  // namespace tactus::wire
