/// Collects the state of a session from its samples, and shows it on one screen.
///
/// No DDS, thread or clock; one thread at a time. Times are those of the reader's monotonic clock.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/roster.hpp"
#include "tools/top/text_table.hpp"

namespace tactus::top {

class Overview {
 public:
  /// `self`: this program. `title`: name of the session, for the first line. `warning`: the second line, if not empty.
  Overview(const session::Origin& self, std::string title, std::int64_t now_ns, std::string warning = {});

  // Samples in the order of their arrival, with its time.
  void on_sample(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_sample(const session::CatalogueEntry& entry, std::int64_t now_ns);
  void on_sample(const session::Metrics& metrics, std::int64_t now_ns);
  void on_sample(const session::ProbeState& state, std::int64_t now_ns);
  void on_sample(const session::EmergencyStop& stop, std::int64_t now_ns);

  [[nodiscard]] bool has_participants() const { return !roster_.entries().empty(); }

  /// Returns the screen. Rates of probe states are over the time since the previous call.
  [[nodiscard]] std::vector<Line> screen(std::int64_t now_ns);

 private:
  /// Figures of a host or HRTC: those of the newest sample, and of the sample before it.
  struct Figures {
    std::uint64_t incarnation = 0;
    std::map<std::string, double> newest, before;
    std::int64_t newest_ns = 0, before_ns = 0;  // sender's clock; before_ns is 0 after the first sample

    /// A value with `decimals`; "-" if the participant has not published it.
    [[nodiscard]] std::string value(const std::string& name, int decimals = 0) const;
    /// Growth of a sum of counters in 1 s; "-" before the second sample.
    [[nodiscard]] std::string rate(const std::vector<std::string>& counters, double unit = 1) const;
    /// `used` as a percentage of `limit`.
    [[nodiscard]] std::string percentage(const std::string& used, const std::string& limit) const;
  };
  /// Probe states of a user.
  struct States {
    session::ProbeState newest;
    std::int64_t newest_ns = 0;
    std::int64_t first_ns = 0;  // arrival of the first state
    std::uint64_t count = 0;    // states since the previous screen
  };
  struct Absent {
    session::RosterEntry entry;
    bool has_left = false;  // false: it fell silent
    std::int64_t since_ns = 0;
  };
  struct Event {
    std::int64_t at_ns;
    std::string text;
  };

  void apply(const std::vector<session::RosterEvent>& events, std::int64_t now_ns);
  void add_event(std::string text, std::int64_t now_ns);
  void track_stops(std::int64_t now_ns);
  [[nodiscard]] std::string state_of(const session::RosterEntry& entry) const;
  [[nodiscard]] Row participant_row(const session::RosterEntry& entry, std::int64_t now_ns,
                                    std::vector<std::string> cells) const;
  void add_absent_rows(session::Role role, std::int64_t now_ns, std::vector<Row>& rows) const;
  [[nodiscard]] Line title_line() const;
  void add_stop_lines(std::vector<Line>& lines) const;
  [[nodiscard]] std::vector<Row> host_rows(std::int64_t now_ns) const;
  [[nodiscard]] std::vector<Row> hrtc_rows(std::int64_t now_ns) const;
  [[nodiscard]] std::vector<Row> user_rows(std::int64_t now_ns) const;
  [[nodiscard]] Row user_row(const session::UserProbe& user, const std::string& hrtc, std::int64_t now_ns) const;
  [[nodiscard]] std::vector<Row> observer_rows(std::int64_t now_ns) const;
  [[nodiscard]] std::vector<Row> event_rows(std::int64_t now_ns) const;
  [[nodiscard]] std::string name_of_user(std::uint64_t user) const;

  std::string title_, warning_;
  session::Roster roster_;
  std::map<std::uint64_t, Absent> absent_;           // by participant
  std::map<std::uint64_t, Figures> figures_;         // by participant
  std::map<std::uint64_t, States> states_;           // by user
  std::map<std::uint64_t, std::string> objects_;     // names, by object
  std::map<std::uint64_t, std::string> stop_texts_;  // newest reason, by issuer
  std::deque<Event> events_;                         // the newest last
  std::size_t stopped_ = 0;                          // hosts and HRTCs at which a stop stands
  const std::int64_t begin_ns_;                      // time of the construction
  std::int64_t screen_ns_;                           // time of the previous screen
};

}  // namespace tactus::top
