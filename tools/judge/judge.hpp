/// Compares a session with its bounds: reads the report of the session and the audits of its contacts, and returns a
/// table of values, bounds and verdicts.
///
/// Input is the JSON of `tactus-sim --json` and of `tactus-mesh audit --json`. A missing key is an error; a row
/// without values falls short. Not realtime.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tactus::judge {

/// Bounds of a session. The defaults leave room for a loaded machine with two cores.
struct Bounds {
  /// Simulated users need some seconds to reach a surface: rows about touch do not apply to a shorter session.
  double shortest_session = 6;           ///< s
  double exact_share = 0.97;             ///< of the cycles that touch the original surface, for each HRTC
  double first_exact = 5;                ///< s from the start of the session to the first exact contact of each user
  double exact_after_touch = 0.2;        ///< s from the first touch of a surface to its first exact contact
  double received_per_needed = 1.4;      ///< vertex splits, not counting those received again after an eviction
  double audited_per_second = 200;       ///< cycles for each HRTC and second of the session
  std::uint64_t audited_enough = 5'000;  ///< cycles for each HRTC, for a session of any length

  double raised_min = 0.08, raised_max = 0.12;  ///< m, the top of the lift
  double held_min = 1.5, held_max = 3;          ///< s
  double left = 0.003;                          ///< m above or below where the object was before the lift
  double copies_apart = 0.015;                  ///< m; for 6 N and a channel with a round trip of up to 40 ms
  double injected = 0.001;                      ///< J
  double port_lowest = -1e-6;                   ///< J
};

/// The bounds of one session in addition to the general ones.
struct Promise {
  bool lift = false;      ///< two users lift an object together
  bool eviction = false;  ///< regions are evicted from the compressed caches and loaded again
  /// Share of all vertex splits that an HRTC may receive; none: no bound for this session.
  std::optional<double> received_share;
};

enum class Verdict : std::uint8_t { kHolds, kFallsShort, kDoesNotApply };

struct Row {
  std::string what, value, bound;
  Verdict verdict;
  std::string reason;  ///< the cause of a shortfall, or why the row does not apply
};

/// One audit file covers one HRTC's log against one original. Throws std::runtime_error that names a missing key.
[[nodiscard]] std::vector<Row> judge(const nlohmann::json& report, const std::vector<nlohmann::json>& audits,
                                     const Promise& promise, const Bounds& bounds = {});

[[nodiscard]] bool all_hold(const std::vector<Row>& rows);

/// Lines of at most 100 columns.
[[nodiscard]] std::string text(const std::vector<Row>& rows);
[[nodiscard]] nlohmann::json json(const std::vector<Row>& rows);

}  // namespace tactus::judge
