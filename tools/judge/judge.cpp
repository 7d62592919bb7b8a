#include "tools/judge/judge.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "session/figures.hpp"
#include "session/printable.hpp"

namespace tactus::judge {
namespace {

using Json = nlohmann::json;
namespace figures = session::figures;

template <class... Values>
std::string formatted(const char* format, Values... values) {
  char buffer[128];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

std::string rounded(double value) { return formatted("%.0f", value); }

std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

/// Sums over the audits of one HRTC's log.
struct HrtcAudit {
  std::uint64_t contact = 0, exact = 0, audited = 0, near_change = 0;
  std::uint64_t needed = 0, received = 0, received_again = 0, of_models = 0;
  std::vector<std::string> without_totals;  // originals for which the log has no totals
};

struct Totals {
  std::map<std::string, HrtcAudit> hrtcs;
  std::uint64_t audits = 0, mismatched = 0, disagreed = 0;
  double max_exact_after = 0;            // time from a probe's first touch to its first exact contact, s
  std::vector<std::string> never_exact;  // probes with contact but without exact contact
};

Totals totals_of(const std::vector<Json>& audits) {
  Totals totals;
  for (const Json& audit : audits) {
    const auto log = audit.at("log").get<std::string>();
    const auto original = audit.at("original").get<std::string>();
    HrtcAudit& hrtc = totals.hrtcs[log];
    ++totals.audits;
    for (const Json& object : audit.at("objects")) {
      hrtc.contact += object.at("contact").get<std::uint64_t>();
      hrtc.exact += object.at("exact_contact").get<std::uint64_t>();
      hrtc.audited += object.at("audited").get<std::uint64_t>();
      hrtc.near_change += object.at("audited_near_change").get<std::uint64_t>();
      totals.mismatched += object.at("mismatched").get<std::uint64_t>();
      totals.disagreed += object.at("fcl").at("disagreed").get<std::uint64_t>();
      for (const Json& probe : object.at("probes")) {
        const Json& after = probe.at("exact_after_ms");
        if (after.is_null())
          totals.never_exact.push_back("probe " + std::to_string(probe.at("probe").get<int>()) + " of " + log + " on " +
                                       original);
        else
          totals.max_exact_after = std::max(totals.max_exact_after, 1e-3 * after.get<double>());
      }
      const auto records = object.find("records");
      if (records == object.end() || !records->contains("received")) {
        hrtc.without_totals.push_back(original);
        continue;
      }
      hrtc.needed += records->at("needed").get<std::uint64_t>();
      hrtc.of_models += records->at("of_model").get<std::uint64_t>();
      hrtc.received += records->at("received").get<std::uint64_t>();
      hrtc.received_again += records->at("returned").get<std::uint64_t>();
    }
  }
  return totals;
}

class Judge {
 public:
  Judge(const Json& report, const std::vector<Json>& audits, const Expectations& expectations, const Bounds& bounds)
      : report_{report}, totals_{totals_of(audits)}, expectations_{expectations}, bounds_{bounds} {
    seconds_ = report.at("duration_s").get<double>();
    if (seconds_ < bounds.min_session)
      too_short_ = formatted("duration %.1f s, this row requires %.0f s", seconds_, bounds.min_session);
  }

  std::vector<Row> run() {
    participants();
    users();
    for (const auto& [name, hrtc] : totals_.hrtcs) {
      exactness(name, hrtc);
      vertex_splits(name, hrtc);
    }
    for (const Json& participant : report_.at("participants"))
      if (participant.at("role") == "hrtc" && totals_.hrtcs.count(participant.at("name").get<std::string>()) == 0)
        add("audited cycles, " + participant.at("name").get<std::string>(), "no audit", "one", false);
    audits();
    evictions();
    lift();
    return std::move(rows_);
  }

 private:
  void add(std::string quantity, std::string value, std::string bound, bool holds, std::string reason = {}) {
    rows_.push_back({std::move(quantity), std::move(value), std::move(bound),
                     holds ? Verdict::kHolds : Verdict::kFallsShort, std::move(reason)});
  }
  void add_not_applicable(std::string quantity, std::string value, std::string reason) {
    rows_.push_back({std::move(quantity), std::move(value), {}, Verdict::kDoesNotApply, std::move(reason)});
  }
  /// Adds a row that does not apply to a short session.
  void add_touch(std::string quantity, std::string value, std::string bound, bool holds, std::string reason = {}) {
    if (too_short_.empty())
      add(std::move(quantity), std::move(value), std::move(bound), holds, std::move(reason));
    else
      add_not_applicable(std::move(quantity), std::move(value), too_short_);
  }

  void participants() {
    std::size_t hosts = 0, hrtcs = 0, stayed = 0;
    std::vector<std::string> gone;
    for (const Json& participant : report_.at("participants")) {
      if (participant.at("role") == "host") ++hosts;
      if (participant.at("role") == "hrtc") ++hrtcs;
      if (participant.at("present_at_end").get<bool>())
        ++stayed;
      else
        gone.push_back(participant.at("name").get<std::string>());
    }
    const auto stop_reason = report_.at("stop_reason").get<std::string>();
    add("session ran to its end", stop_reason.empty() ? "yes" : "no", "yes", stop_reason.empty(), stop_reason);
    add("hosts and HRTCs present at the end", std::to_string(stayed) + " of " + std::to_string(hosts + hrtcs), "all",
        hosts > 0 && hrtcs > 0 && gone.empty(), listed(gone));
  }

  void users() {
    const Json& users = report_.at("users");
    std::vector<std::string> idle, never, late, with_fault;
    double last = 0;
    for (const Json& user : users) {
      const auto name = user.at("name").get<std::string>();
      const Json& first = user.at("first_exact_contact_s");
      if (user.at("touches").get<unsigned>() == 0) idle.push_back(name);
      if (first.is_null())
        never.push_back(name);
      else
        last = std::max(last, first.get<double>());
      if (!first.is_null() && first.get<double>() > bounds_.max_first_exact) late.push_back(name);
      if (user.at("faults").get<unsigned>() > 0) with_fault.push_back(name);
    }
    add_touch("users who touched something",
              std::to_string(users.size() - idle.size()) + " of " + std::to_string(users.size()), "all",
              !users.empty() && idle.empty(), idle.empty() ? "" : "not " + listed(idle));
    never.insert(never.end(), late.begin(), late.end());
    add_touch("first exact contact of the last user", formatted("%.2f s", last),
              formatted("<= %.0f s", bounds_.max_first_exact), !users.empty() && never.empty(),
              never.empty() ? "" : "never exact, or too late: " + listed(never));
    add("users with a latched fault", std::to_string(with_fault.size()), "0", with_fault.empty(), listed(with_fault));
  }

  void exactness(const std::string& name, const HrtcAudit& hrtc) {
    const double share = hrtc.contact > 0 ? static_cast<double>(hrtc.exact) / static_cast<double>(hrtc.contact) : 0;
    add_touch("share of exact contact, " + name, formatted("%.2f %%", 100 * share),
              formatted(">= %.0f %%", 100 * bounds_.min_exact_share), share >= bounds_.min_exact_share,
              hrtc.contact > 0 ? "" : "no contact");
    const double min = std::min(std::floor(bounds_.min_audited_per_second * seconds_),
                                static_cast<double>(bounds_.max_required_audits));
    add_touch("audited cycles, " + name, std::to_string(hrtc.audited), ">= " + rounded(min),
              static_cast<double>(hrtc.audited) >= min);
  }

  void vertex_splits(const std::string& name, const HrtcAudit& hrtc) {
    const std::string per_needed = "vertex splits without repeats / needed, " + name;
    const std::string of_all = "vertex splits received / all, " + name;
    if (!hrtc.without_totals.empty() || hrtc.of_models == 0) {
      const std::string reason =
          "no totals of records (HRTC killed, or audit without --spm): " + listed(hrtc.without_totals);
      add_touch(per_needed, "unknown", formatted("<= %.2f", bounds_.max_received_per_needed), false, reason);
      add_touch(of_all, "unknown", "known", false, reason);
      return;
    }
    const auto first = static_cast<double>(hrtc.received - std::min(hrtc.received, hrtc.received_again));
    const double ratio = hrtc.needed > 0 ? first / static_cast<double>(hrtc.needed) : 0;
    // There is no lower bound: a contact that lacks a needed split is not exact, so it lowers the share of exact
    // contact.
    add_touch(per_needed, formatted("%.3f", ratio), formatted("<= %.2f", bounds_.max_received_per_needed),
              hrtc.needed > 0 && ratio <= bounds_.max_received_per_needed,
              hrtc.needed > 0 ? "" : "the paths of this HRTC needed no vertex splits");
    const double share = static_cast<double>(hrtc.received) / static_cast<double>(hrtc.of_models);
    const std::string value = formatted("%.2f %%", 100 * share);
    if (expectations_.received_share)
      add_touch(of_all, value, formatted("<= %.0f %%", 100 * *expectations_.received_share),
                share <= *expectations_.received_share);
    else
      add_not_applicable(of_all, value, "no bound was given for these models and this duration");
  }

  void audits() {
    std::uint64_t near_change = 0;
    for (const auto& [name, hrtc] : totals_.hrtcs) near_change += hrtc.near_change;
    add_touch("audited cycles, at most 10 after a region change", std::to_string(near_change), ">= 100",
              near_change >= 100);
    add("exact contacts that differ from the original", std::to_string(totals_.mismatched), "0",
        totals_.audits > 0 && totals_.mismatched == 0, totals_.audits > 0 ? "" : "no audit was given");
    add("audited cycles where FCL disagrees", std::to_string(totals_.disagreed), "0",
        totals_.audits > 0 && totals_.disagreed == 0, totals_.audits > 0 ? "" : "no audit was given");
    add_touch(
        "first touch of a surface until exact contact", formatted("%.0f ms", 1e3 * totals_.max_exact_after),
        formatted("<= %.0f ms", 1e3 * bounds_.max_exact_after_touch),
        totals_.audits > 0 && totals_.never_exact.empty() && totals_.max_exact_after <= bounds_.max_exact_after_touch,
        totals_.never_exact.empty() ? "" : "never: " + listed(totals_.never_exact));
  }

  void evictions() {
    double evicted = 0, reloaded = 0;
    for (const Json& participant : report_.at("participants")) {
      const Json& values = participant.at("figures");
      evicted += values.value(figures::kEvictions, 0.0);
      reloaded += values.value(figures::kReloads, 0.0);
    }
    const std::pair<const char*, double> rows[] = {{"regions evicted from the compressed caches", evicted},
                                                   {"regions loaded again after eviction", reloaded}};
    for (const auto& [quantity, count] : rows) {
      if (expectations_.has_eviction)
        add_touch(quantity, rounded(count), ">= 1", count >= 1);
      else
        add_not_applicable(quantity, rounded(count), "the caches may be large enough for all touched regions");
    }
  }

  void lift() {
    if (!expectations_.has_lift) {
      add_not_applicable("lift of an object by two users", "-", "no lift in this session");
      return;
    }
    const auto between = [this](const char* quantity, double value, const char* unit, double low, double high,
                                int digits, bool known) {
      const auto number = [&](double x) { return formatted("%.*f", digits, x); };
      add(std::string{"lift: "} + quantity, known ? number(value) + " " + unit : "unknown",
          number(low) + " to " + number(high) + " " + unit, known && value >= low && value <= high);
    };
    const Json& objects = report_.at("objects");
    const bool moved = objects.size() == 1;
    const auto of_object = [&](const char* key) { return moved ? objects[0].at(key).get<double>() : 0.0; };
    between("raised", 1e3 * of_object("max_raised_m"), "mm", 1e3 * bounds_.min_raised, 1e3 * bounds_.max_raised, 1,
            moved);
    between("held", of_object("held_s"), "s", bounds_.min_held, bounds_.max_held, 2, moved);
    between("final height above the start", 1e3 * of_object("last_raised_m"), "mm", -1e3 * bounds_.max_offset,
            1e3 * bounds_.max_offset, 1, moved);
    double apart = 0, lowest = 0;
    std::size_t coupled = 0;
    for (const Json& participant : report_.at("participants")) {
      const Json& values = participant.at("figures");
      if (participant.at("role") != "hrtc" || values.value(figures::kCopiesApart, 0.0) <= 0) continue;
      ++coupled;
      apart = std::max(apart, 1e-6 * values.at(figures::kCopiesApart).get<double>());
      lowest = std::min(lowest, 1e-6 * values.at(figures::kPortLowest).get<double>());
    }
    add("lift: HRTCs with a coupled copy", std::to_string(coupled), "2", coupled == 2);
    between("distance of the copies", 1e3 * apart, "mm", 0, 1e3 * bounds_.max_copy_distance, 1, coupled == 2);
    between("energy injected between the copies", 1e3 * report_.at("injected_j").get<double>(), "mJ", 0,
            1e3 * bounds_.max_injected, 3, moved);
    add("lift: lowest energy of a hand's port", coupled == 2 ? formatted("%.3f uJ", 1e6 * lowest) : "unknown",
        formatted(">= %.0f uJ", 1e6 * bounds_.min_port_energy), coupled == 2 && lowest >= bounds_.min_port_energy);
  }

  const Json& report_;
  Totals totals_;
  Expectations expectations_;
  Bounds bounds_;
  double seconds_ = 0;
  std::string too_short_;
  std::vector<Row> rows_;
};

const char* name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kHolds:
      return "holds";
    case Verdict::kFallsShort:
      return "falls short";
    case Verdict::kDoesNotApply:
      break;
  }
  return "does not apply";
}

}  // namespace

std::vector<Row> judge(const Json& report, const std::vector<Json>& audits, const Expectations& expectations,
                       const Bounds& bounds) {
  return Judge{report, audits, expectations, bounds}.run();
}

bool all_hold(const std::vector<Row>& rows) {
  return std::none_of(rows.begin(), rows.end(), [](const Row& row) { return row.verdict == Verdict::kFallsShort; });
}

std::string text(const std::vector<Row>& rows) {
  constexpr int kQuantity = 50, kValue = 12, kBound = 16;
  constexpr std::size_t kReason = 94;
  std::string out =
      formatted("%-*s %*s  %-*s  %s\n", kQuantity, "Judgement", kValue, "value", kBound, "bound", "verdict");
  for (const Row& row : rows) {
    out += formatted("%-*.*s %*s  %-*s  %s\n", kQuantity, kQuantity, session::printable(row.quantity).c_str(), kValue,
                     row.value.c_str(), kBound, row.bound.c_str(), name_of(row.verdict));
    if (!row.reason.empty()) out += "    " + session::printable(row.reason.substr(0, kReason)) + "\n";
  }
  const auto short_of =
      std::count_if(rows.begin(), rows.end(), [](const Row& row) { return row.verdict == Verdict::kFallsShort; });
  const auto not_applicable =
      std::count_if(rows.begin(), rows.end(), [](const Row& row) { return row.verdict == Verdict::kDoesNotApply; });
  const auto all = static_cast<std::ptrdiff_t>(rows.size());
  return out + formatted("%td rows hold, %td fall short, %td do not apply\n", all - short_of - not_applicable, short_of,
                         not_applicable);
}

Json json(const std::vector<Row>& rows) {
  Json list = Json::array();
  for (const Row& row : rows)
    list.push_back({{"quantity", row.quantity},
                    {"value", row.value},
                    {"bound", row.bound},
                    {"verdict", name_of(row.verdict)},
                    {"reason", row.reason}});
  return list;
}

}  // namespace tactus::judge
