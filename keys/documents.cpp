#include "keys/documents.hpp"

#include <algorithm>
#include <array>
#include <iterator>

namespace tactus::keys {
namespace {

constexpr char kHead[] =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
    "xsi:noNamespaceSchemaLocation=\"http://www.omg.org/spec/DDS-Security/20170901/";
// All domains: the base domain of a session is an option of its programs. Cyclone DDS knows no domain above 230.
constexpr char kDomains[] = "<domains><id_range><min>0</min><max>230</max></id_range></domains>\n";

/// The partitions of the sessions of `tactus latency` (latency/measure.cpp).
constexpr char kTestSessions[] = "latency.*";

constexpr std::time_t kZoneMargin = 24 * 3600;

constexpr unsigned bit(Role role) { return 1u << static_cast<unsigned>(role); }
constexpr unsigned kHost = bit(Role::kHost), kHrtc = bit(Role::kHrtc), kUser = bit(Role::kUser),
                   kOperator = bit(Role::kOperator), kObserver = bit(Role::kObserver),
                   kAll = kHost | kHrtc | kUser | kOperator | kObserver;

struct Rule {
  WriteRight right;
  unsigned roles;
};
// As the column "writer" of docs/reference/topics.md. Testers may write all topics.
constexpr std::array kRules{
    Rule{{"tactus_roster", false}, kAll},
    Rule{{"tactus_clock", false}, kAll},
    Rule{{"tactus_stop", false}, kAll},
    Rule{{"tactus_catalogue", false}, kHost},
    Rule{{"tactus_base", false}, kHost},
    Rule{{"tactus_records", false}, kHost},
    Rule{{"tactus_object_grant", false}, kHost},
    Rule{{"tactus_metrics", false}, kHost | kHrtc},
    Rule{{"tactus_object_pose", false}, kHost | kHrtc},
    Rule{{"tactus_demand", false}, kHrtc | kUser | kOperator | kObserver},
    Rule{{"tactus_shown_regions", false}, kHrtc},
    Rule{{"tactus_probe_state", false}, kHrtc},
    Rule{{"tactus_device_command", false}, kHrtc},
    Rule{{"tactus_object_claim", false}, kHrtc},
    Rule{{"tactus_object_copy", false}, kHrtc},
    Rule{{"tactus_intent", true}, kUser | kOperator},
    Rule{{"tactus_device_pose", true}, kUser | kOperator},
    Rule{{"tactus_control", false}, kUser | kOperator},
    Rule{{"tactus_reset", false}, kOperator},
    Rule{{"tactus_end", false}, kOperator},
};

std::string element(const std::string& name, const std::string& text) {
  return "<" + name + ">" + text + "</" + name + ">";
}

/// Names of subjects may have characters that XML reserves.
std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '&')
      result += "&amp;";
    else if (c == '<')
      result += "&lt;";
    else if (c == '>')
      result += "&gt;";
    else
      result += c;
  }
  return result;
}

std::string subject_element(const std::string& subject) { return element("subject_name", escaped(subject)); }

/// Fast DDS reads these times as local ones, so they have a margin of a day; the certificate has the exact times.
std::string time_text(std::time_t time) { return utc_text(time, "%Y-%m-%dT%H:%M:%S"); }

/// The beginning of a document of this schema. Appended, because GCC 12 warns of strings that are added to a new one.
std::string beginning_with(const char* schema) {
  std::string text;
  text.append(kHead).append(schema).append("\">\n");
  return text;
}

std::string criteria(const std::string& kind, const std::vector<std::string>& topics,
                     const std::vector<std::string>& partitions) {
  std::string topic_list, partition_list;
  for (const std::string& topic : topics) topic_list += element("topic", topic);
  for (const std::string& partition : partitions) partition_list += element("partition", escaped(partition));
  return element(kind, element("topics", topic_list) + element("partitions", partition_list)) + "\n";
}

}  // namespace

std::vector<WriteRight> rights_of(Role role) {
  std::vector<WriteRight> rights;
  for (const Rule& rule : kRules)
    if (role == Role::kTester)
      rights.push_back({rule.right.topic, false});
    else if ((rule.roles & bit(role)) != 0)
      rights.push_back(rule.right);
  return rights;
}

std::vector<Role> writers_of(std::string_view topic) {
  std::vector<Role> roles;
  for (const Rule& rule : kRules)
    for (const Role role : kRoles)
      if (rule.right.topic == topic && (rule.roles & bit(role)) != 0) roles.push_back(role);
  return roles;
}

std::string governance_document() {
  return beginning_with("omg_shared_ca_governance.xsd") + "<domain_access_rules><domain_rule>\n" + kDomains +
         "<allow_unauthenticated_participants>false</allow_unauthenticated_participants>\n"
         "<enable_join_access_control>true</enable_join_access_control>\n"
         "<discovery_protection_kind>ENCRYPT_WITH_ORIGIN_AUTHENTICATION</discovery_protection_kind>\n"
         "<liveliness_protection_kind>NONE</liveliness_protection_kind>\n"
         "<rtps_protection_kind>NONE</rtps_protection_kind>\n"
         "<topic_access_rules><topic_rule><topic_expression>*</topic_expression>\n"
         "<enable_discovery_protection>true</enable_discovery_protection>\n"
         "<enable_liveliness_protection>false</enable_liveliness_protection>\n"
         "<enable_read_access_control>true</enable_read_access_control>\n"
         "<enable_write_access_control>true</enable_write_access_control>\n"
         "<metadata_protection_kind>ENCRYPT_WITH_ORIGIN_AUTHENTICATION</metadata_protection_kind>\n"
         "<data_protection_kind>NONE</data_protection_kind>\n"
         "</topic_rule></topic_access_rules>\n</domain_rule></domain_access_rules></dds>\n";
}

std::string permissions_document(const std::string& subject, Role role, const std::vector<std::string>& users,
                                 std::time_t valid_from, std::time_t valid_until) {
  std::vector<std::string> everywhere, of_users, user_partitions;
  for (const WriteRight& right : rights_of(role)) (right.of_user ? of_users : everywhere).push_back(right.topic);
  for (const std::string& user : users) user_partitions.push_back("*/u/" + user);  // of any session
  std::string rules =
      element("allow_rule", kDomains + criteria("publish", everywhere, {role == Role::kTester ? kTestSessions : "*"}) +
                                criteria("subscribe", {"*"}, {"*"}));
  // A rule of its own: within one, Fast DDS 2.9 accepts the topic of one list with the partition of another.
  if (!of_users.empty() && !users.empty())
    rules += "\n" + element("allow_rule", kDomains + criteria("publish", of_users, user_partitions));
  return beginning_with("omg_shared_ca_permissions.xsd") + "<permissions><grant name=\"member\">\n" +
         subject_element(subject) + "\n" +
         element("validity", element("not_before", time_text(valid_from - kZoneMargin)) +
                                 element("not_after", time_text(valid_until + kZoneMargin))) +
         "\n" + rules + "\n" + element("default", "DENY") + "\n</grant></permissions></dds>\n";
}

bool is_for(const std::string& permissions, const std::string& subject) {
  return permissions.find(subject_element(subject)) != std::string::npos;
}

}  // namespace tactus::keys
