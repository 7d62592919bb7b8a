#include "keys/identity.hpp"

#include <algorithm>
#include <charconv>
#include <utility>
#include <vector>

#include "keys/certificates.hpp"

namespace tactus::keys {
namespace {

constexpr char kSeparator = '\n', kInstance = '.';
constexpr std::size_t kMaxText = 767, kMaxName = 63, kMaxSerial = 40;

std::vector<std::string_view> fields_of(std::string_view text) {
  std::vector<std::string_view> fields;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(kSeparator, begin), text.size());
    fields.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return fields;
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_name_character(char c) {
  return is_digit(c) || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '-' || c == '_';
}
bool is_dotted_name_character(char c) { return is_name_character(c) || c == '.'; }
template <class Condition>
bool has_only(std::string_view text, std::size_t max, const Condition& condition) {
  return !text.empty() && text.size() <= max && std::all_of(text.begin(), text.end(), condition);
}

Subject stated_subject(const std::string& group, const Identity& identity) {
  return {group,           std::string{name_of(identity.role)}, identity.name, identity.permitted,
          identity.serial, std::to_string(identity.valid_until)};
}

}  // namespace

std::string instance_name(const std::string& member, const std::string& instance) {
  return member + kInstance + instance;
}

bool is_name_of(std::string_view participant, std::string_view member) noexcept {
  if (participant.substr(0, member.size()) != member) return false;
  const std::string_view rest = participant.substr(member.size());
  return rest.empty() || (rest.size() > 1 && rest.front() == kInstance);
}

Identity identity_of(const Member& member, std::string participant) {
  return {member.role, member.name, member.serial, member.valid_until, member.permitted, std::move(participant)};
}

std::string text_of(const Identity& identity) {
  std::string text{name_of(identity.role)};
  for (const std::string& field : {identity.name, identity.serial, std::to_string(identity.valid_until),
                                   text_of(identity.permitted), identity.participant})
    text += kSeparator + field;
  return text;
}

std::optional<Identity> read_identity(std::string_view text) {
  const std::vector<std::string_view> fields = fields_of(text);
  constexpr std::size_t kFields = 6;
  if (text.size() > kMaxText || fields.size() != kFields) return std::nullopt;
  Identity identity;
  const auto* const role =
      std::find_if(std::begin(kRoles), std::end(kRoles), [&](Role known) { return name_of(known) == fields[0]; });
  // Only what an authority issues: OpenSSL refuses other characters in a subject.
  if (role == std::end(kRoles) || !has_only(fields[1], kMaxName, is_name_character) ||
      !has_only(fields[2], kMaxSerial, [](char c) { return is_digit(c) || (c >= 'A' && c <= 'F'); }) ||
      !has_only(fields[3], 20, is_digit) || fields[4].size() > kMaxPermitted ||
      !has_only(fields[5], kMaxName, is_dotted_name_character))
    return std::nullopt;
  identity.permitted = permitted_in(fields[4]);
  for (const std::string& permitted : identity.permitted)
    if (!has_only(permitted, kMaxName, is_dotted_name_character)) return std::nullopt;
  identity.role = *role;
  identity.name = fields[1];
  identity.serial = fields[2];
  const std::string_view until = fields[3];
  const auto [end, error] = std::from_chars(until.data(), until.data() + until.size(), identity.valid_until);
  if (error != std::errc{} || end != until.data() + until.size()) return std::nullopt;
  identity.participant = fields[5];
  if (!is_name_of(identity.participant, identity.name)) return std::nullopt;
  return identity;
}

GuidBegin guid_begin_of(const std::string& group, const Identity& identity) {
  const auto hash = hash_of(stated_subject(group, identity));
  GuidBegin begin;
  std::uint8_t above = 1;  // the first bit of the GUID is set, and the hash follows
  for (std::size_t i = 0; i < begin.size(); ++i) {
    begin[i] = static_cast<std::uint8_t>(above << 7u | hash[i] >> 1u);
    above = hash[i] & 1u;
  }
  return begin;
}

bool is_certificate_of(std::string_view text, const std::string& group, const Identity& identity) {
  const Certificate certificate = certificate_in(text);
  return certificate != nullptr && serial_of(*certificate) == identity.serial &&
         hash_of_subject(*certificate) == hash_of(stated_subject(group, identity));
}

}  // namespace tactus::keys
