#include "tools/watch/sample_text.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <string_view>

#include "session/messages.hpp"
#include "session/printable.hpp"
#include "session/status_names.hpp"
#include "tools/hex.hpp"

namespace tactus::watch {
namespace {

/// Fields with the id of a session, participant, user or object. In a roster entry, `session` is a name.
constexpr std::array<std::string_view, 7> kIdFields{"session",   "participant", "user_id",     "object_id",
                                                    "reference", "peer",        "serving_host"};
constexpr std::array<std::string_view, 3> kHashFields{"digest", "hash", "scene"};
constexpr std::size_t kMaxNames = 1u << 16;
constexpr std::size_t kMaxShown = 16;  // elements of a list in text

template <std::size_t Count>
bool contains(const std::array<std::string_view, Count>& all, const std::string& name) {
  return std::find(all.begin(), all.end(), name) != all.end();
}

/// Returns JSON without control characters. JSON itself escapes only those below U+0020, but a terminal also obeys
/// U+007F to U+009F.
std::string dump(const Fields& value) {
  const std::string json = value.dump(-1, ' ', false, Fields::error_handler_t::replace);
  std::string escaped;
  escaped.reserve(json.size());
  for (std::size_t i = 0; i < json.size(); ++i) {
    const auto code = static_cast<unsigned char>(json[i]);
    const auto next = static_cast<unsigned char>(i + 1 < json.size() ? json[i + 1] : 0);
    const bool is_c1 = code == 0xc2 && next >= 0x80 && next < 0xa0;
    if (code == 0x7f || is_c1) {
      std::array<char, 8> text{};
      std::snprintf(text.data(), text.size(), "\\u%04x", unsigned{is_c1 ? next : code});
      escaped += text.data();
      i += is_c1 ? 1 : 0;
    } else {
      escaped += json[i];
    }
  }
  return escaped;
}

/// Replaces the list of figures, each with a name and a value, by one object.
Fields figures_by_name(const Fields& list) {
  Fields figures = Fields::object();
  for (const Fields& figure : list) figures[figure.at("name").get<std::string>()] = figure.at("value");
  return figures;
}

/// Returns a list as text, without the elements after the first kMaxShown. A list of names has no brackets.
std::string list_text(const Fields& list) {
  if (!list.empty() && std::all_of(list.begin(), list.end(), [](const Fields& value) { return value.is_string(); })) {
    std::string names;
    for (const Fields& name : list) names += (names.empty() ? "" : " ") + name.get<std::string>();
    return names;
  }
  std::string out = "[";
  for (std::size_t i = 0; i < std::min(list.size(), kMaxShown); ++i) out += (i == 0 ? "" : ", ") + dump(list[i]);
  if (list.size() > kMaxShown) out += ", " + std::to_string(list.size() - kMaxShown) + " more";
  return out + "]";
}

void add_lines(const Fields& value, const std::string& path, std::string& out) {
  if (value.is_object() && !value.empty()) {
    for (const auto& [key, member] : value.items())
      add_lines(member, (path.empty() ? "" : path + ".") + session::printable(key), out);
    return;
  }
  out += path + ": ";
  out += value.is_string()  ? session::printable(value.get<std::string>())
         : value.is_array() ? session::printable(list_text(value))
         : value.is_null()  ? "none"
                            : dump(value);
  out += '\n';
}

}  // namespace

Fields SampleReader::decode(const std::string& type, std::span<const std::uint8_t> encoded) const {
  const std::string json = schema_.json(type, encoded);
  constexpr bool kThrows = false;
  Fields fields = Fields::parse(json, nullptr, kThrows);
  if (!fields.is_discarded()) return fields;
  // A string is not UTF-8, so JSON cannot contain it. As a JSON string itself, the text gets replacement characters.
  return Fields::parse(Fields::parse(dump(json)).get<std::string>());
}

void SampleReader::add_name(const std::string& name) {
  if (names_.size() < kMaxNames) names_[session::id_of(name)] = name;
}

void SampleReader::add_names(const Fields& entry) {
  // Adds every string. A string that is no name has no effect, because no sample contains its hash as an id.
  for (const Fields& member : entry) {
    if (member.is_string()) add_name(member.get<std::string>());
    if (member.is_structured()) add_names(member);
  }
}

void SampleReader::name(Fields& fields) const {
  if (fields.is_array())
    for (Fields& element : fields) name(element);
  if (!fields.is_object()) return;
  Fields named = Fields::object();
  for (auto& [key, value] : fields.items()) {
    Fields& out = named[key];
    if (value.is_number_unsigned() && contains(kIdFields, key)) {
      const auto id = value.get<std::uint64_t>();
      const auto known = names_.find(id);
      if (id != 0) out = known != names_.end() ? known->second : tools::hex(id);
    } else if (value.is_number_unsigned() && contains(kHashFields, key)) {
      out = tools::hex(value.get<std::uint64_t>());
    } else if (value.is_number_unsigned() && key == "status") {
      const auto status = value.get<std::uint32_t>();
      out = session::status_names(status);
      if ((status & session::kFault) != 0) named["fault_reason"] = session::fault_reason(status);
    } else if (value.is_array() && key == "figures") {
      out = figures_by_name(value);
    } else {
      out = std::move(value);
      name(out);
    }
  }
  fields = std::move(named);
}

bool SampleReader::is_selected(const Fields& fields, const SampleFilter& filter) {
  const auto matches = [&](const char* field, const std::string& wanted) {
    return wanted.empty() || (fields.contains(field) && fields[field] == session::id_of(wanted));
  };
  return matches("user_id", filter.user) && matches("participant", filter.from);
}

std::optional<std::string> SampleReader::refusal(const std::string& type, const SampleFilter& filter) const {
  const std::vector<std::string> columns = schema_.columns(type);
  const auto lacks = [&](const char* field) {
    return std::find(columns.begin(), columns.end(), field) == columns.end();
  };
  if (!filter.user.empty() && lacks("user_id"))
    return "--user: found samples without a user, expected a topic of users, such as tactus_probe_state";
  if (!filter.from.empty() && lacks("participant"))
    return "--from: found samples without a participant, expected another topic than tactus_base and tactus_records";
  return std::nullopt;
}

std::string text(const Fields& fields) {
  std::string out;
  add_lines(fields, "", out);
  return out;
}

std::string json_line(const Fields& fields) { return dump(fields); }

}  // namespace tactus::watch
