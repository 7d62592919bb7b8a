/// Results of a benchmark: rows of measured quantities and their bounds, printed as a table and written as JSON.
///
/// `scripts/bench report` makes docs/benchmarks.md from the JSON files. Percentiles follow session/percentile.hpp.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "session/percentile.hpp"

namespace tactus::bench {

using Samples = session::Samples<>;

/// Sample for work that did not finish. It exceeds every upper bound.
constexpr double kUnfinished = std::numeric_limits<double>::infinity();

/// Returns a / b, or kUnfinished if the result is not a number or one of the two is not finite.
[[nodiscard]] inline double ratio(double a, double b) noexcept {
  return std::isfinite(a) && std::isfinite(b) && b != 0 ? a / b : kUnfinished;
}

/// The things from which a value was computed, such as cycles, runs or regions, and their number. For a single
/// measurement, `name` is singular and `n` is 1.
struct Population {
  Population(std::string what, std::size_t count) : name{std::move(what)}, n{count} {}
  std::string name;
  std::size_t n;
};

enum class Verdict { kHolds, kFallsShort, kNoBound };

enum class Limit { kNone, kAtMost, kAtLeast };

/// One measured quantity and its bound.
struct Row {
  std::string figure;  ///< name of the quantity
  Population population;
  double value;
  std::string unit;
  Limit limit = Limit::kNone;
  double bound = 0;
  bool virtual_time = false;

  /// Returns kFallsShort for every bound if the population is empty or the value is not finite.
  [[nodiscard]] Verdict verdict() const noexcept;
};

/// Upper bound of the percentile at `share` (0 to 1).
struct PercentileBound {
  double share;
  double at_most;
};

/// The measured model, and the settings of the measurement.
struct Subject {
  std::string model;  ///< file, or generator with its seed
  std::uint64_t digest = 0;
  std::uint32_t faces = 0;  ///< 0: the benchmark uses no model
  std::string settings;     ///< all settings that change the results, such as radius, speed and budget
};

class Report {
 public:
  explicit Report(Subject subject) : subject_{std::move(subject)} {}

  /// Sets Row::virtual_time of the rows that are added after this call.
  void set_virtual_time(bool on) noexcept { virtual_time_ = on; }
  /// Puts this text before Row::figure of the rows that are added after this call.
  void set_prefix(std::string prefix) { prefix_ = std::move(prefix); }

  /// Adds rows with p50, p99, p99.9 and the maximum of `samples`, and with every percentile in `bounds`. If there are
  /// too few samples to distinguish p99 or p99.9 from the maximum, its row is omitted. `population` is
  /// Population::name of the rows.
  void add_percentiles(const std::string& figure, const std::string& population, const std::string& unit,
                       const Samples& samples, std::initializer_list<PercentileBound> bounds = {});
  /// Without this overload, {"cycles", 3} would become a string of three characters.
  void add_percentiles(const std::string&, const Population&, const std::string&, const Samples&,
                       std::initializer_list<PercentileBound> = {}) = delete;
  /// Adds a row without a bound.
  void add_value(const std::string& figure, const Population& population, const std::string& unit, double value);
  void add_at_most(const std::string& figure, const Population& population, const std::string& unit, double value,
                   double bound);
  void add_at_least(const std::string& figure, const Population& population, const std::string& unit, double value,
                    double bound);
  /// Adds a line of plain text below the rows.
  void add_note(std::string text) { notes_.push_back(std::move(text)); }

  [[nodiscard]] const std::vector<Row>& rows() const noexcept { return rows_; }

  /// Prints the report to standard output. Also writes it to the file `json`, unless that name is empty. `command` is
  /// the command line that repeats the run. Returns 0 if there is a row and none falls short, else 1. Throws
  /// std::runtime_error if the file cannot be written.
  [[nodiscard]] int finish(const std::string& bench, const std::string& command, const std::string& json) const;

 private:
  void print(const std::string& bench, const std::string& command) const;
  void write(const std::string& bench, const std::string& command, const std::string& json) const;

  Subject subject_;
  std::vector<Row> rows_;
  std::vector<std::string> notes_;
  bool virtual_time_ = false;
  std::string prefix_;
};

}  // namespace tactus::bench
