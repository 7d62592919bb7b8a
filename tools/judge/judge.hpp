/// Compares the report of a session and the audits of its contacts with the session's bounds. Returns a table of
/// values, bounds and verdicts.
///
/// The inputs are the JSON of `tactus-sim --json` and of `tactus-mesh audit --json`. A missing key is an error. A row
/// without a value falls short.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tactus::judge {

/// Bounds of every session. A loaded machine with two cores meets the default bounds.
struct Bounds {
  /// Duration in s below which rows about touch do not apply: simulated users take some seconds to reach a surface.
  double min_session = 6;
  double min_exact_share = 0.97;       ///< exact contact cycles divided by contact cycles, for each HRTC
  double max_first_exact = 5;          ///< time from the start of the session to each user's first exact contact, s
  double max_exact_after_touch = 0.2;  ///< time from the first touch of a surface to the first exact contact, s
  /// Vertex splits received, without those received again after an eviction, divided by vertex splits needed.
  double max_received_per_needed = 1.4;
  double min_audited_per_second = 200;        ///< audited cycles of each HRTC, per second of the session
  std::uint64_t max_required_audits = 5'000;  ///< audited cycles of each HRTC that suffice for any duration

  double min_raised = 0.08, max_raised = 0.12;  ///< height of the lift, m
  double min_held = 1.5, max_held = 3;          ///< duration of the lift, s
  double max_offset = 0.003;                    ///< difference of the object's heights before and after the lift, m
  double max_copy_distance = 0.015;             ///< m; allows 6 N on a channel with a round trip of up to 40 ms
  double max_injected = 0.001;                  ///< energy that the couplings between the copies add, J
  double min_port_energy = -1e-6;               ///< lowest energy of any hand's port, J
};

/// The expected events of one session.
struct Expectations {
  bool has_lift = false;      ///< two users lift an object together
  bool has_eviction = false;  ///< regions are evicted from the compressed caches and loaded again
  /// Share of all vertex splits that an HRTC may receive; empty: no bound for this session.
  std::optional<double> received_share;
};

enum class Verdict : std::uint8_t { kHolds, kFallsShort, kDoesNotApply };

struct Row {
  std::string quantity;
  std::string value, bound;
  Verdict verdict;
  std::string reason;  ///< reason of a shortfall, or reason why the row does not apply
};

/// Each audit compares one HRTC's log with one original. Throws nlohmann::json::exception, whose text names a
/// missing key.
[[nodiscard]] std::vector<Row> judge(const nlohmann::json& report, const std::vector<nlohmann::json>& audits,
                                     const Expectations& expectations, const Bounds& bounds = {});

[[nodiscard]] bool all_hold(const std::vector<Row>& rows);

/// Returns lines of at most 100 columns.
[[nodiscard]] std::string text(const std::vector<Row>& rows);
[[nodiscard]] nlohmann::json json(const std::vector<Row>& rows);

}  // namespace tactus::judge
