/// The rows in which every benchmark states its figures: as a table, as JSON, and later on the page of benchmarks.
///
/// A row names its population and the number of samples in it. Percentiles follow session/percentile.hpp.
#pragma once

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

/// A sample for work that did not finish: late for every bound.
constexpr double kUnfinished = std::numeric_limits<double>::infinity();

/// What a figure is about, and how many of it there were: cycles, runs, regions; 1 for a single measurement.
struct Population {
  Population(std::string what, std::size_t count = 1) : name{std::move(what)}, n{count} {}
  Population(const char* what, std::size_t count = 1) : name{what}, n{count} {}
  std::string name;
  std::size_t n;
};

enum class Verdict { kHolds, kFallsShort, kNoBound };

enum class Limit { kNone, kAtMost, kAtLeast };

/// One figure and its bound.
struct Row {
  std::string figure;
  Population population;
  double value;
  std::string unit;
  Limit limit = Limit::kNone;
  double bound = 0;
  bool virtual_time = false;

  /// Without samples, and with a value that is not finite, every bound falls short.
  [[nodiscard]] Verdict verdict() const noexcept;
};

/// A percentile must be `at_most`.
struct PercentileBound {
  double share;
  double at_most;
};

/// What the figures were measured on.
struct Subject {
  std::string model;  ///< file or generator, with its seed
  std::uint64_t digest = 0;
  std::uint32_t faces = 0;  ///< 0: not about a model
  std::string settings;     ///< radius, speed, budget: whatever the figures depend on
};

class Report {
 public:
  explicit Report(Subject subject) : subject_{std::move(subject)} {}

  /// The rows added from now on are, or are not, in virtual time.
  void virtual_time(bool on) noexcept { virtual_time_ = on; }

  /// Rows with p50, p99, p99.9 and the maximum of `samples`, as far as there are enough samples to tell these apart,
  /// and every percentile in `bounds`. The samples give the population its number.
  void row(const std::string& figure, const Population& population, const std::string& unit, const Samples& samples,
           std::initializer_list<PercentileBound> bounds = {});
  /// A row without a bound.
  void figure(const std::string& figure, const Population& population, const std::string& unit, double value);
  void at_most(const std::string& figure, const Population& population, const std::string& unit, double value,
               double bound);
  void at_least(const std::string& figure, const Population& population, const std::string& unit, double value,
                double bound);
  /// A line of plain text below the rows.
  void note(std::string text) { notes_.push_back(std::move(text)); }

  [[nodiscard]] const std::vector<Row>& rows() const noexcept { return rows_; }

  /// Prints everything to standard output and writes `json` unless that is empty. 0 when no row falls short, else 1.
  /// `command` is how the benchmark was called. Throws std::runtime_error when the file cannot be written.
  [[nodiscard]] int finish(const std::string& bench, const std::string& command, const std::string& json) const;

 private:
  void print(const std::string& bench, const std::string& command) const;
  void write(const std::string& bench, const std::string& command, const std::string& json) const;

  Subject subject_;
  std::vector<Row> rows_;
  std::vector<std::string> notes_;
  bool virtual_time_ = false;
};

}  // namespace tactus::bench
