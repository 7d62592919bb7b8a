/// The samples that a script has received from a session: the states of probes, and the objects that hosts offer.
///
/// Samples are not trusted: their numbers are limited. No DDS, thread or clock: times are those of the arrival of
/// samples, monotonic clock, ns. One thread at a time.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "session/messages.hpp"
#include "session/roster.hpp"

namespace tactus::python {

/// A probe state as a row. World frame, SI.
struct StateRow {
  std::int64_t session_time_ns;
  std::array<double, 3> position;
  std::array<double, 4> orientation;
  std::array<double, 3> velocity, force, proxy;
  double radius, stiffness, error_bound, data_age;
  std::uint64_t object_id;
  std::uint32_t status;
  bool in_contact, exact;
};

/// The states of probes, by user id.
class ReceivedStates {
 public:
  /// Rows stored for each user until they are taken; older rows are dropped.
  static constexpr std::size_t kMaxRows = 1u << 16;
  /// Rows stored for all users. Above this limit, the older half of the rows of the user with the most rows is dropped.
  static constexpr std::size_t kMaxAllRows = 1u << 20;
  static constexpr std::size_t kMaxUsers = 1024;
  /// Above kMaxUsers, a new user replaces the one whose newest state is the oldest, if it is older than this.
  static constexpr std::int64_t kSilentNs = 1'000'000'000;

  void add(std::uint64_t user, const StateRow& row, std::int64_t now_ns) {
    if (users_.size() >= kMaxUsers && users_.count(user) == 0 && !drop_silent_user(now_ns)) return;
    User& of = users_[user];
    of.newest = row;
    of.received_ns = now_ns;
    of.rows.push_back(row);
    ++rows_;
    if (of.rows.size() > kMaxRows) drop_rows(of, 1);
    if (rows_ <= kMaxAllRows) return;
    const auto has_fewer = [](const auto& a, const auto& b) { return a.second.rows.size() < b.second.rows.size(); };
    User& largest = std::max_element(users_.begin(), users_.end(), has_fewer)->second;
    drop_rows(largest, (largest.rows.size() + 1) / 2);
  }
  /// The newest state of a user; none if there is none.
  [[nodiscard]] std::optional<StateRow> newest(std::uint64_t user) const {
    const auto found = users_.find(user);
    return found == users_.end() ? std::nullopt : std::optional{found->second.newest};
  }
  /// Returns and removes the rows of a user, oldest first.
  [[nodiscard]] std::vector<StateRow> take(std::uint64_t user) {
    const auto found = users_.find(user);
    if (found == users_.end()) return {};
    const std::deque<StateRow> rows = std::exchange(found->second.rows, {});
    rows_ -= rows.size();
    return {rows.begin(), rows.end()};
  }
  /// Number of rows of all users.
  [[nodiscard]] std::size_t rows() const noexcept { return rows_; }

 private:
  struct User {
    std::deque<StateRow> rows;
    StateRow newest{};
    std::int64_t received_ns = 0;  // of `newest`
  };
  void drop_rows(User& of, std::size_t count) {
    of.rows.erase(of.rows.begin(), of.rows.begin() + static_cast<std::ptrdiff_t>(count));
    rows_ -= count;
  }
  [[nodiscard]] bool drop_silent_user(std::int64_t now_ns) {
    if (now_ns < full_until_ns_) return false;
    const auto is_older = [](const auto& a, const auto& b) { return a.second.received_ns < b.second.received_ns; };
    const auto oldest = std::min_element(users_.begin(), users_.end(), is_older);
    full_until_ns_ = oldest->second.received_ns + kSilentNs + 1;
    if (now_ns < full_until_ns_) return false;
    rows_ -= oldest->second.rows.size();
    users_.erase(oldest);
    return true;
  }

  std::map<std::uint64_t, User> users_;
  std::size_t rows_ = 0;
  std::int64_t full_until_ns_ = 0;  // no user is silent before, so that not each id of a flood causes a search
};

/// The objects that hosts offer. An object exists until all programs that offer it have withdrawn it, left, or started
/// again. As at HRTCs, the objects of a program that is gone without a leave message remain.
class OfferedObjects {
 public:
  /// Pairs of an object and a program that offers it. Above this limit, a new offer removes those of programs that are
  /// not in the roster, at most once in a second.
  static constexpr std::size_t kMaxOffers = 8192;

  void add(const session::CatalogueEntry& entry, const session::Roster& roster, std::int64_t now_ns) {
    if (const auto object = offers_.find(entry.object); object != offers_.end()) {
      count_ -= std::erase_if(object->second, [&](const session::CatalogueEntry& offer) {
        return is_same_program(offer.origin, entry.origin);
      });
      if (object->second.empty()) offers_.erase(object);
    }
    if (entry.withdrawn) return;
    if (count_ >= kMaxOffers && now_ns - dropped_ns_ >= kDropPeriodNs) {
      dropped_ns_ = now_ns;
      erase([&](const session::CatalogueEntry& offer) { return roster.find(offer.origin.participant) == nullptr; });
    }
    if (count_ >= kMaxOffers) return;
    offers_[entry.object].push_back(entry);
    ++count_;
  }
  /// Removes the offers of a program that has left, and those of its earlier processes.
  void remove(const session::Origin& host) {
    erase([&](const session::CatalogueEntry& offer) {
      return offer.origin.participant == host.participant && offer.origin.incarnation <= host.incarnation;
    });
  }
  /// Removes the offers of the earlier processes of a program that has started again.
  void remove_earlier(const session::Origin& host) {
    erase([&](const session::CatalogueEntry& offer) {
      return offer.origin.participant == host.participant && offer.origin.incarnation < host.incarnation;
    });
  }
  /// The newest entry of each object, by name.
  [[nodiscard]] std::map<std::string, session::CatalogueEntry> newest() const {
    std::map<std::string, session::CatalogueEntry> entries;
    for (const auto& [object, offers] : offers_) entries[object] = offers.back();
    return entries;
  }

 private:
  [[nodiscard]] static bool is_same_program(const session::Origin& a, const session::Origin& b) noexcept {
    return a.participant == b.participant && a.incarnation == b.incarnation;
  }
  template <class Condition>
  void erase(Condition&& condition) {
    for (auto& [object, offers] : offers_) count_ -= std::erase_if(offers, condition);
    std::erase_if(offers_, [](const auto& object) { return object.second.empty(); });
  }

  static constexpr std::int64_t kDropPeriodNs = 1'000'000'000;  // so that not each offer of a flood causes a search
  std::map<std::string, std::vector<session::CatalogueEntry>> offers_;  // by object, the newest last
  std::size_t count_ = 0;
  std::int64_t dropped_ns_ = -kDropPeriodNs;
};

}  // namespace tactus::python
