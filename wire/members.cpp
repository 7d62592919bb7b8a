#include "wire/members.hpp"

#include <algorithm>
#include <iterator>
#include <mutex>
#include <set>
#include <string_view>
#include <utility>

#include "keys/documents.hpp"
#include "session/check.hpp"
#include "wire/transport/protection.hpp"

namespace tactus::wire {
namespace {

constexpr std::uint32_t kLease = 0x02, kUserData = 0x2c;  // parameters (RTPS 2.2, 9.6.2)
constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kRoomIntervalNs = kSecondNs;
constexpr std::int64_t kPresentNs = 10'000'000'000;  // since the last announcement
constexpr int kDifferingChecks = 3;
constexpr std::int64_t kSilentNs = 60'000'000'000;  // of silence, after which a proved participant may be removed

std::string subject_of(const keys::Identity& identity) {
  return std::string{name_of(identity.role)} + " " + identity.name;
}

/// Two certificates of a member differ by their serial number.
std::string serial_text(const std::string& serial) { return ", serial number " + serial; }

/// The first bytes of the GUIDs of all participants with one certificate.
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

/// Returns whether the keys of a member permit the role that its program has in the session.
bool may_be(keys::Role role, session::Role in_session) {
  switch (in_session) {
    case session::Role::kHost:
      return role == keys::Role::kHost;
    case session::Role::kHrtc:
      return role == keys::Role::kHrtc;
    case session::Role::kClient:
      return role == keys::Role::kUser || role == keys::Role::kOperator;
    case session::Role::kViewer:
      return true;
  }
  return false;
}

bool contains(const std::vector<std::uint64_t>& ids, std::uint64_t id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

std::vector<std::uint64_t> ids_of_names(const keys::Permitted& names) {
  std::vector<std::uint64_t> ids;
  for (const std::string& name : names) ids.push_back(session::id_of(name));
  return ids;
}

/// Returns whether a message of the authentication is for a participant with this certificate
/// (ParticipantGenericMessage, DDS Security 1.1, 7.4.3).
bool is_for(const keys::GuidBegin& certificate, const RtpsBytes& payload) {
  constexpr std::uint32_t kDestinationAt = 52;
  return payload.size >= kDestinationAt + certificate.size() &&
         std::equal(certificate.begin(), certificate.end(), payload.at + kDestinationAt);
}

/// `serials`: of revoked certificates that a newer list lacks.
std::string text_of_missing(const std::vector<std::string>& serials) {
  constexpr std::size_t kMaxNamed = 20;
  std::string text = "found a list without " + std::to_string(serials.size()) +
                     (serials.size() == 1 ? " key" : " keys") +
                     " that the earlier one revokes; was the authority restored from a backup? revoke " +
                     (serials.size() == 1 ? "it" : "them") + " again: ";
  for (std::size_t i = 0; i < std::min(serials.size(), kMaxNamed); ++i) text += (i == 0 ? "" : ", ") + serials[i];
  return text + (serials.size() > kMaxNamed ? ", ..." : "");
}

}  // namespace

Members::Members(std::filesystem::path folder, keys::Member self, const std::string& participant, AuditLog& audit,
                 Clock clock)
    : folder_{std::move(folder)},
      self_{std::move(self)},
      own_id_{session::id_of(participant)},
      own_begin_{keys::guid_begin_of(self_.group, keys::identity_of(self_, participant))},
      audit_{audit},
      clock_{std::move(clock)} {
  const keys::RevokedKeys list = keys::read_revoked(folder_);
  revoked_ = {list.serials.begin(), list.serials.end()};
  list_made_ = list.made;
}

bool Members::admits(const std::uint8_t* message, std::uint32_t size, const Address& from) {
  const GuidPrefix sender = sender_of(message);
  std::uint32_t at = kRtpsHeader;
  std::vector<RtpsBytes> handshakes;
  bool is_encrypted = false;
  while (const std::optional<Submessage> found = submessage_at(message, size, at)) {
    const std::optional<RtpsData> data = data_of(*found);
    is_encrypted = is_encrypted || found->id == kSecurePrefixId;
    if (data && data->writer == kAnnouncements && !admits_announcement(data->payload, sender, from)) return false;
    // The library sends each handshake to all participants, and ignores those for others.
    if (data && data->writer == kAuthentication && is_for(own_begin_, data->payload))
      handshakes.push_back(data->payload);
    if (found->last) break;
    at = found->next;
  }
  {
    const std::lock_guard lock{mutex_};
    const auto author = participants_.find(sender);
    if (author == participants_.end() || has_ended(author->second)) return false;
    if (certificates_.at(author->second.certificate).is_cut_off) return false;
    if (author->second.refused_until_ns != 0 && clock_() < author->second.refused_until_ns) return false;
    if (is_encrypted) author->second.encrypted_ns = clock_();
  }
  return handshakes.empty() || admits_handshakes(handshakes, sender, from);
}

/// The library checks the certificate of a handshake with the list of revoked ones that it has read at the start. So
/// the certificate must be the one that the sender has announced, which is checked with the newest list.
bool Members::admits_handshakes(const std::vector<RtpsBytes>& handshakes, const GuidPrefix& sender,
                                const Address& from) {
  keys::Identity identity;
  {
    const std::lock_guard lock{mutex_};
    const auto known = participants_.find(sender);
    if (known == participants_.end()) return false;
    if (!has_few_handshakes(known->second, handshakes.size())) {
      audit_.add({"too many handshakes", "", from(), ""});
      return false;
    }
    const Certificate& announced = certificates_.at(known->second.certificate);
    identity = {announced.role, announced.name, announced.serial, announced.valid_until, announced.permitted, ""};
  }
  // Without the lock, because OpenSSL takes locks of its own for a certificate.
  for (const RtpsBytes& handshake : handshakes) {
    const RtpsBytes certificate = certificate_in(handshake);
    const std::string_view text{reinterpret_cast<const char*>(certificate.at), certificate.size};
    if (text.empty() || keys::is_certificate_of(text, self_.group, identity)) continue;
    audit_.add({"authentication of another participant", "", from(), ""});
    return false;
  }
  return true;
}

/// Returns whether the library may read `more` messages of handshakes of a participant, and counts them.
bool Members::has_few_handshakes(Participant& participant, std::size_t more) {
  const std::int64_t now_ns = clock_();
  const auto count = static_cast<double>(more);
  if (participant.failed_handshakes >= kMaxFailedHandshakes || participant.handshakes.left(now_ns) < count)
    return false;
  if (!participant.is_proved) {
    if (unproved_handshakes_from_.size() > kMaxUnproved)
      std::erase_if(unproved_handshakes_from_, [&](const auto& entry) { return entry.second.is_full(now_ns); });
    Allowance& of_address =
        unproved_handshakes_from_
            .try_emplace(participant.address, kMaxUnprovedRateOfAddress, kMaxUnprovedBurstOfAddress, now_ns)
            .first->second;
    if (of_address.left(now_ns) < count || unproved_handshakes_.left(now_ns) < count) return false;
    of_address.take(count, now_ns);
    unproved_handshakes_.take(count, now_ns);
    participant.unproved_handshakes += static_cast<std::uint32_t>(more);
  }
  participant.handshakes.take(count, now_ns);
  return true;
}

bool Members::admits_announcement(const RtpsBytes& payload, const GuidPrefix& sender, const Address& from) {
  constexpr std::uint32_t kAlignment = 4;
  std::optional<keys::Identity> identity;
  std::int64_t lease_ns = kSecondNs;
  int guids = 0, identities = 0;
  bool is_well_formed = true;
  ParameterList parameters = parameters_of(payload);
  while (const auto parameter = parameters.next()) {
    const RtpsBytes& value = parameter->value;
    // The library rounds lengths up, and takes a key hash for the GUID.
    if (value.size % kAlignment != 0 || parameter->id == kKeyHashParameter) is_well_formed = false;
    if (parameter->id == kGuidParameter) {
      ++guids;
      if (value.size < sender.size() || !std::equal(sender.begin(), sender.end(), value.at)) is_well_formed = false;
    }
    if (parameter->id == kLease && value.size >= 8) {
      const std::uint32_t seconds = value.number(0, 4);  // the infinite lease has the most
      if (seconds >= kMaxLease.count()) is_well_formed = false;
      lease_ns = std::max(lease_ns, (std::int64_t{seconds} + 1) * kSecondNs);  // 1 s for the fraction
    }
    if (parameter->id == kUserData && value.size >= 4) {
      ++identities;
      const std::uint32_t length = std::min(value.number(0, 4), value.size - 4);
      identity = keys::read_identity({reinterpret_cast<const char*>(value.at) + 4, length});
    }
  }
  if (is_well_formed && guids == 1 && identities == 1 && identity) return record(*identity, sender, lease_ns, from);
  audit_.add({"unknown program", "", from(), identity ? "states to be " + subject_of(*identity) : ""});
  return false;
}

/// Records the participant of an announcement. Returns false if it is refused.
bool Members::record(const keys::Identity& identity, const GuidPrefix& sender, std::int64_t lease_ns,
                     const Address& from) {
  const std::int64_t now_ns = clock_();
  const std::uint64_t id = session::id_of(identity.participant);
  {
    const std::lock_guard lock{mutex_};
    const auto known = participants_.find(sender);
    if (known != participants_.end() && !known->second.is_proved && may_forget(known->second, now_ns)) {
      participants_.erase(known);  // it begins again
    } else if (known != participants_.end()) {
      Participant& participant = known->second;
      const Certificate& certificate = certificates_.at(participant.certificate);
      if (certificate.is_cut_off || certificate.name != identity.name || certificate.role != identity.role ||
          certificate.serial != identity.serial || certificate.valid_until != identity.valid_until ||
          certificate.permitted != identity.permitted)
        return false;
      if (!participant.is_proved &&
          now_ns - participant.recorded_ns > std::chrono::nanoseconds{kMaxUnprovedTime}.count())
        return false;
      participant.announced_ns = now_ns;
      participant.lease_ns = std::max(participant.lease_ns, lease_ns);
      if (!contains(participant.ids, id) && participant.ids.size() < Participant::kMaxIds &&
          !is_id_of_another(id, participant.certificate))
        participant.ids.push_back(id);
      return true;
    }
  }
  const keys::GuidBegin begin = begin_of(sender);
  if (keys::guid_begin_of(self_.group, identity) != begin) {
    audit_.add({"unknown program", "", from(), "states to be " + subject_of(identity)});
    return false;
  }
  const std::lock_guard lock{mutex_};
  // Everyone can state an identity that matches a GUID. So nothing is stored for those that are refused.
  if (const char* const why = reason_to_cut_off(identity, begin)) {
    audit_.add({"cut off", subject_of(identity), from(), why + serial_text(identity.serial)});
    return false;
  }
  if (is_id_of_another(id, begin)) {
    audit_.add(
        {"unknown program", "", from(), "claims to be " + subject_of(identity) + ", with the id of another program"});
    return false;
  }
  const std::string address = from();
  if (!make_room(address)) {
    audit_.add({"too many programs", "", address, ""});
    return false;
  }
  certificates_.try_emplace(begin, Certificate{subject_of(identity),
                                               identity.name,
                                               identity.serial,
                                               identity.role,
                                               identity.valid_until,
                                               identity.permitted,
                                               ids_of_names(identity.permitted),
                                               {}});
  participants_[sender] = {begin, {id}, now_ns, address, now_ns, lease_ns};
  return true;
}

bool Members::is_revoked(const std::string& serial) const { return revoked_.count(serial) != 0; }

/// Returns why a certificate is refused; null if it is not.
const char* Members::reason_to_cut_off(const keys::Identity& identity, const keys::GuidBegin& begin) const {
  if (is_revoked(identity.serial)) return "revoked";
  if (std::time(nullptr) > identity.valid_until) return "expired";
  const auto known = certificates_.find(begin);
  return known != certificates_.end() && known->second.is_cut_off ? "too many refused samples" : nullptr;
}

/// Returns the name of the member with another certificate that uses an id: this program, or a proved participant; null
/// if there is none.
const std::string* Members::other_member_with(std::uint64_t id, const keys::GuidBegin& certificate) const {
  if (id == own_id_ && certificate != own_begin_) return &self_.name;
  for (const auto& [prefix, other] : participants_) {
    if (!other.is_proved || other.certificate == certificate) continue;
    const Certificate& of_other = certificates_.at(other.certificate);
    if (!of_other.is_cut_off && (contains(other.ids, id) || contains(of_other.ids, id))) return &of_other.name;
  }
  return nullptr;
}

/// An id is a hash of a name. A member could choose the name of an instance so that its id equals that of another
/// member. So the id of this program, and an id that a proved participant uses, are refused to all other certificates.
bool Members::is_id_of_another(std::uint64_t id, const keys::GuidBegin& certificate) const {
  return other_member_with(id, certificate) != nullptr;
}

/// Lets programs with other keys of the same member use the ids of programs with these keys, which are cut off or gone.
/// All these ids are of names that the member may use.
void Members::pass_on_ids(const keys::GuidBegin& earlier) {
  const Certificate& of_earlier = certificates_.at(earlier);
  std::vector<std::uint64_t> ids = of_earlier.ids;
  for (const auto& [prefix, participant] : participants_)
    if (participant.certificate == earlier) ids.insert(ids.end(), participant.ids.begin(), participant.ids.end());
  for (auto& [begin, certificate] : certificates_) {
    if (begin == earlier || certificate.is_cut_off || certificate.name != of_earlier.name) continue;
    for (const std::uint64_t id : ids)
      if (!is_id_of_another(id, begin)) learn_id(certificate, id);
  }
}

bool Members::has_room(const std::string& address) const {
  std::size_t unproved = 0, from_address = 0;
  for (const auto& [prefix, participant] : participants_) {
    if (participant.is_proved) continue;
    ++unproved;
    from_address += participant.address == address ? 1 : 0;
  }
  return participants_.size() < kMaxParticipants && unproved < kMaxUnproved && from_address < kMaxUnprovedFromAddress;
}

/// Returns whether a participant has been silent for so long that the library no longer stores it. The library gets
/// messages of an unproved one until its lease has ended (has_ended), and stores it for another lease. One that has
/// failed is recorded for kMaxUnprovedTime, because a new one in its place has new handshakes.
bool Members::may_forget(const Participant& participant, std::int64_t now_ns) {
  const std::int64_t silent_ns = now_ns - participant.announced_ns;
  if (participant.is_proved) return silent_ns > kSilentNs;
  return silent_ns > 2 * participant.lease_ns &&
         (participant.failed_handshakes == 0 ||
          now_ns - participant.recorded_ns > std::chrono::nanoseconds{kMaxUnprovedTime}.count());
}

/// Forgets silent participants if there are too many. At most once in a second, because it takes long.
bool Members::make_room(const std::string& address) {
  if (has_room(address)) return true;
  const std::int64_t now_ns = clock_();
  if (now_ns - made_room_ns_ < kRoomIntervalNs) return false;
  made_room_ns_ = now_ns;
  std::erase_if(participants_, [&](const auto& entry) { return may_forget(entry.second, now_ns); });
  std::set<keys::GuidBegin> used;
  for (const auto& [prefix, participant] : participants_) used.insert(participant.certificate);
  std::erase_if(certificates_,
                [&](const auto& entry) { return used.count(entry.first) == 0 && entry.second.refused < kMaxRefused; });
  return has_room(address);
}

/// Returns whether a participant without a proved identity has announced nothing for its lease.
bool Members::has_ended(const Participant& participant) const {
  return !participant.is_proved && clock_() - participant.announced_ns > participant.lease_ns;
}

void Members::cut_off(const keys::GuidBegin& begin, const char* why) {
  Certificate& certificate = certificates_.at(begin);
  certificate.is_cut_off = true;
  audit_.add({"cut off", certificate.subject, "", why + serial_text(certificate.serial)});
  pass_on_ids(begin);
}

/// Returns whether the author of a sample is the program that it names: by its own name, or by one that it has
/// announced or that a sample of its member has stated.
bool Members::is_sender(const Participant& author, const Certificate& certificate, const Claim& claim) const {
  if (!claim.participant || contains(author.ids, *claim.participant) || contains(certificate.ids, *claim.participant))
    return true;
  return states_own_name(certificate, claim) && !is_id_of_another(*claim.participant, author.certificate);
}

bool Members::states_own_name(const Certificate& certificate, const Claim& claim) {
  return claim.name != nullptr && keys::is_name_of(*claim.name, certificate.name) &&
         session::id_of(*claim.name) == claim.participant;
}

/// Returns whether a program may use an id that is missing in Participant::ids: forged announcements may have kept it
/// out, or a program with other keys of the same member uses it. Then its samples do not count until one states its
/// name and no other program has the id, and it is not cut off for them. A program states its name within a second.
bool Members::may_be_diverted(const Participant& author, const Certificate& certificate, const Claim& claim) const {
  const std::string* const other = other_member_with(*claim.participant, author.certificate);
  if (other != nullptr) return *other == certificate.name;
  return author.ids.size() == Participant::kMaxIds &&
         clock_() - author.recorded_ns < std::chrono::nanoseconds{kMaxUnprovedTime}.count();
}

/// Stores the id of a program of this member.
void Members::learn_id(Certificate& certificate, std::uint64_t id) {
  constexpr std::size_t kMaxPrograms = 64;  // with the same keys
  if (contains(certificate.ids, id)) return;
  if (certificate.ids.size() == kMaxPrograms) certificate.ids.erase(certificate.ids.begin());
  certificate.ids.push_back(id);
}

const char* Members::refusal_of(const Participant& author, const Certificate& certificate, const Claim& claim,
                                const char* topic) const {
  if (!may_write(certificate.role, topic)) return "not permitted";
  if (!is_sender(author, certificate, claim)) return "false sender";
  if (certificate.role == keys::Role::kTester) return nullptr;
  const std::vector<std::uint64_t>& permitted = certificate.permitted_ids;
  const auto is_permitted = [&](std::uint64_t id) {
    return permitted.empty() || std::find(permitted.begin(), permitted.end(), id) != permitted.end();
  };
  if (certificate.role == keys::Role::kHost && claim.object != 0 && !is_permitted(claim.object))
    return "object not permitted";
  if (certificate.role != keys::Role::kHost && claim.user != 0 && !is_permitted(claim.user))
    return "user not permitted";
  if (claim.entry == nullptr) return nullptr;
  if (!may_be(certificate.role, claim.entry->role)) return "role not permitted";
  const bool may_forward_stops = certificate.role == keys::Role::kHost || certificate.role == keys::Role::kHrtc;
  if (!claim.entry->stops.empty() && !may_forward_stops) return "role not permitted";
  return has_permitted_users(certificate, *claim.entry) ? nullptr : "user not permitted";
}

/// A client lists the users that it brings, and an HRTC those that it serves. Others list none.
bool Members::has_permitted_users(const Certificate& certificate, const session::RosterEntry& entry) {
  const auto is_permitted = [&](const std::string& user) {
    return std::find(certificate.permitted.begin(), certificate.permitted.end(), user) != certificate.permitted.end();
  };
  const bool serves_all = certificate.role == keys::Role::kHrtc && certificate.permitted.empty();
  const bool brings = certificate.role == keys::Role::kUser || certificate.role == keys::Role::kOperator;
  const auto& served = entry.served_users;
  return (entry.users.empty() || (brings && std::all_of(entry.users.begin(), entry.users.end(), is_permitted))) &&
         (served.empty() || serves_all ||
          (certificate.role == keys::Role::kHrtc &&
           std::all_of(served.begin(), served.end(),
                       [&](const session::UserProbe& user) { return is_permitted(user.user); })));
}

bool Members::is_author(const GuidPrefix& participant, const Claim& claim, const char* topic) {
  const std::lock_guard lock{mutex_};
  const auto author = participants_.find(participant);
  if (author == participants_.end()) return false;  // it was not admitted, so the library cannot have matched it
  Certificate& certificate = certificates_.at(author->second.certificate);
  const char* const why = refusal_of(author->second, certificate, claim, topic);
  if (why == nullptr) {
    if (states_own_name(certificate, claim)) learn_id(certificate, *claim.participant);
    if (claim.entry != nullptr && session::invalid_field(*claim.entry) == nullptr)
      author->second.list_made = claim.entry->revoked_made_s;
    return !certificate.is_cut_off;
  }
  audit_.add({why, certificate.subject, "", topic});
  if (is_sender(author->second, certificate, claim) || !may_be_diverted(author->second, certificate, claim))
    count_refused(author->second.certificate);
  return false;
}

void Members::count_refused(const keys::GuidBegin& begin) {
  Certificate& certificate = certificates_.at(begin);
  if (certificate.is_cut_off) return;  // the number shows why, until this program starts again
  const std::int64_t now_ns = clock_();
  if (now_ns - certificate.refused_since_ns > std::chrono::nanoseconds{kRefusedWindow}.count()) {
    certificate.refused_since_ns = now_ns;
    certificate.refused = 0;
  }
  if (++certificate.refused == kMaxRefused) cut_off(begin, "too many refused samples");
}

void Members::report_invalid(const GuidPrefix& participant, const char* topic, const char* reason) {
  const std::lock_guard lock{mutex_};
  const auto author = participants_.find(participant);
  if (author == participants_.end()) return;
  const std::string& subject = certificates_.at(author->second.certificate).subject;
  audit_.add({"invalid sample", subject, "", std::string{topic} + ", " + reason});
  count_refused(author->second.certificate);
}

void Members::report_excess(const GuidPrefix& participant, const char* topic) const {
  const std::lock_guard lock{mutex_};
  const auto known = participants_.find(participant);
  if (known != participants_.end())
    audit_.add({"too many samples", certificates_.at(known->second.certificate).subject, "", topic});
}

void Members::report_refused_user(std::uint64_t client, const std::string& user) const {
  const std::lock_guard lock{mutex_};
  const auto brings = std::find_if(participants_.begin(), participants_.end(), [&](const auto& known) {
    const Participant& participant = known.second;
    return participant.is_proved &&
           std::find(participant.ids.begin(), participant.ids.end(), client) != participant.ids.end();
  });
  if (brings != participants_.end())
    audit_.add({"user not served", certificates_.at(brings->second.certificate).subject, "", user});
}

std::vector<std::uint64_t> Members::ids_of(const GuidPrefix& participant) const {
  const std::lock_guard lock{mutex_};
  const auto known = participants_.find(participant);
  if (known == participants_.end()) return {};
  std::vector<std::uint64_t> ids = known->second.ids;
  const std::vector<std::uint64_t>& named = certificates_.at(known->second.certificate).ids;
  ids.insert(ids.end(), named.begin(), named.end());
  return ids;
}

/// The library waits for a participant that never answers in the handshake, and reports no failure.
void Members::on_announcement(const GuidPrefix& participant) {
  const std::int64_t now_ns = clock_();
  const std::lock_guard lock{mutex_};
  const auto known = participants_.find(participant);
  if (known == participants_.end() || known->second.is_proved) return;
  const Certificate& certificate = certificates_.at(known->second.certificate);
  if (certificate.serial == self_.serial) return;  // the own announcements come back, and need no handshake
  std::int64_t& since_ns = known->second.expected_since_ns;
  if (since_ns == 0) since_ns = now_ns;
  if (now_ns - since_ns > std::chrono::nanoseconds{kMaxHandshake}.count())
    audit_.add({"not authenticated", "", "", "states to be " + certificate.subject + ", and does not prove it"});
}

void Members::on_authentication(const GuidPrefix& participant, bool succeeded) {
  const std::lock_guard lock{mutex_};
  const auto known = participants_.find(participant);
  const std::string stated = known == participants_.end() ? "" : certificates_.at(known->second.certificate).subject;
  if (succeeded && known != participants_.end()) {
    Participant& proved = known->second;
    std::erase_if(proved.ids, [&](std::uint64_t id) { return is_id_of_another(id, proved.certificate); });
    proved.is_proved = true;
    proved.proved_ns = clock_();
    proved.failed_handshakes = 0;
    unproved_handshakes_.give_back(proved.unproved_handshakes);
    if (const auto from = unproved_handshakes_from_.find(proved.address); from != unproved_handshakes_from_.end())
      from->second.give_back(proved.unproved_handshakes);
    proved.unproved_handshakes = 0;
    audit_.add({"joined", stated, "", ""});
  } else if (!succeeded) {
    if (known != participants_.end() && !known->second.is_proved) ++known->second.failed_handshakes;
    audit_.add({"not authenticated", "", "", stated.empty() ? "" : "states to be " + stated});
  }
}

/// An unproved participant keeps its place (may_forget).
void Members::on_gone(const GuidPrefix& participant) {
  const std::lock_guard lock{mutex_};
  const auto known = participants_.find(participant);
  if (known == participants_.end()) return;
  // One without a proof may have got that of this program.
  if (known->second.is_proved || known->second.unproved_handshakes > 0) record_removal(participant);
  if (!known->second.is_proved) return;
  known->second.is_proved = false;
  pass_on_ids(known->second.certificate);
  participants_.erase(known);
}

void Members::record_removal(const GuidPrefix& participant) {
  if (removed_ns_.size() >= kMaxParticipants)
    removed_ns_.erase(std::min_element(removed_ns_.begin(), removed_ns_.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; }));
  removed_ns_[participant] = clock_();
}

std::vector<GuidPrefix> Members::removed() const {
  const std::lock_guard lock{mutex_};
  std::vector<std::pair<std::int64_t, GuidPrefix>> found;
  for (const auto& [prefix, removed_ns] : removed_ns_) {
    const auto known = participants_.find(prefix);
    if (known != participants_.end() && !known->second.is_proved) found.emplace_back(removed_ns, prefix);
  }
  std::sort(found.rbegin(), found.rend());
  std::vector<GuidPrefix> removed;
  for (const auto& [removed_ns, prefix] : found) removed.push_back(prefix);
  return removed;
}

void Members::on_removed_by(const GuidPrefix& participant) {
  const std::int64_t now_ns = clock_();
  const std::lock_guard lock{mutex_};
  const auto known = participants_.find(participant);
  if (known == participants_.end() || !known->second.is_proved ||
      now_ns - known->second.encrypted_ns < std::chrono::nanoseconds{kMinSilence}.count() ||
      now_ns - known->second.proved_ns < std::chrono::nanoseconds{kMinProved}.count() ||
      now_ns < known->second.refused_until_ns)
    return;
  known->second.refused_until_ns = now_ns + 2 * known->second.lease_ns;  // the library removes it after one lease
  audit_.add({"removed by peer", certificates_.at(known->second.certificate).subject, "",
              "it has removed this program; both prove their identities again"});
}

std::time_t Members::list_made() const {
  const std::lock_guard lock{mutex_};
  return list_made_;
}

/// Reads the list of revoked certificates again.
void Members::read_list(std::vector<std::string>& reports) {
  const std::string file = (folder_ / keys::files::kRevoked).string();
  std::optional<keys::RevokedKeys> list;
  try {
    list = keys::read_revoked(folder_);
  } catch (const keys::KeyError& error) {
    reports.push_back(std::string{error.what()} + "; the earlier list stays in force");
    return;
  }
  const std::lock_guard lock{mutex_};
  std::set<std::string> serials{list->serials.begin(), list->serials.end()};
  if (list->made < list_made_) {
    reports.push_back(file + ": found the list of " + keys::utc_text(list->made) + ", older than that of " +
                      keys::utc_text(list_made_) + ", which stays in force; copy the newest one from the authority");
  } else if (list->made != list_made_ ||
             !std::includes(revoked_.begin(), revoked_.end(), serials.begin(), serials.end())) {
    reports.push_back("read a new list: " + text_of(*list));
    audit_.add({"new list", "", "", text_of(*list)});
    std::vector<std::string> missing;
    std::set_difference(revoked_.begin(), revoked_.end(), serials.begin(), serials.end(), std::back_inserter(missing));
    if (!missing.empty()) reports.push_back(file + ": " + text_of_missing(missing));
    if (missing.size() > kMaxEarlierRevoked) missing.resize(kMaxEarlierRevoked);
    serials.insert(missing.begin(), missing.end());
    revoked_ = std::move(serials);
    list_made_ = list->made;
    for (auto& [prefix, participant] : participants_) participant.differing_checks = 0;
  }
}

/// Adds messages about present programs whose list of revoked certificates is another one.
void Members::compare_lists(std::vector<std::string>& reports) {
  const std::int64_t now_ns = clock_();
  for (auto& [prefix, participant] : participants_) {
    const bool is_present = participant.is_proved && now_ns - participant.announced_ns < kPresentNs;
    if (!is_present || participant.list_made == 0) continue;
    participant.differing_checks = participant.list_made == list_made_ ? 0 : participant.differing_checks + 1;
    // The other program may read a list that has just been copied up to 5 s later. There is one report of a difference,
    // because a changed program can state any time.
    if (participant.differing_checks != kDifferingChecks) continue;
    const std::string& other = certificates_.at(participant.certificate).subject;
    const bool is_own_older = list_made_ < participant.list_made;
    const std::string older = keys::utc_text(std::min(list_made_, participant.list_made)),
                      newer = keys::utc_text(std::max(list_made_, participant.list_made));
    reports.push_back(
        (is_own_older
             ? folder_.string() + ": found the list of revoked keys of " + older + "; " + other + " has a newer one"
             : other + " uses the list of revoked keys of " + older + "; this program has a newer one") +
        ", of " + newer + "; copy the newest revoked.pem from the authority");
  }
}

std::vector<std::string> Members::check_again(std::time_t now) {
  std::vector<std::string> reports;
  read_list(reports);
  const std::lock_guard lock{mutex_};
  compare_lists(reports);
  std::set<keys::GuidBegin> proved;
  for (const auto& [prefix, participant] : participants_)
    if (participant.is_proved) proved.insert(participant.certificate);
  for (auto& [begin, certificate] : certificates_) {
    if (certificate.is_cut_off || (!is_revoked(certificate.serial) && now <= certificate.valid_until)) continue;
    certificate.is_cut_off = true;
    if (proved.count(begin) == 0) continue;  // anybody may have stated it
    cut_off(begin, is_revoked(certificate.serial) ? "revoked" : "expired");
    reports.push_back("the keys of " + certificate.subject +
                      (is_revoked(certificate.serial) ? " are revoked"
                                                      : " have expired on " + keys::utc_text(certificate.valid_until)) +
                      "; its messages are refused from now on");
  }
  if (is_revoked(self_.serial))
    reports.push_back("the keys of this program are revoked; other programs refuse its messages");
  else if (now > self_.valid_until)
    reports.push_back(
        "the keys of this program have expired; other programs refuse its messages. Make new ones on the machine of "
        "the authority with: " +
        keys::replace_command(self_));
  return reports;
}

}  // namespace tactus::wire
