/// What every benchmark ends with: one table, its bounds, an exit status and the same as JSON.
///
/// A figure names its population (all cycles, contact cycles, cycles with changes): a percentile without one says
/// nothing. Percentiles come from stored samples, nearest rank.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace tactus::bench {

/// Stored samples of one quantity.
class Samples {
 public:
  void reserve(std::size_t count) { values_.reserve(count); }
  void add(double value) {
    values_.push_back(value);
    sorted_ = false;
  }
  [[nodiscard]] std::size_t size() const noexcept { return values_.size(); }
  /// Smallest sample that at least `percent` % of all do not exceed; 0 without samples. Sorts when needed.
  [[nodiscard]] double percentile(double percent) const;
  [[nodiscard]] double max() const { return percentile(100); }
  [[nodiscard]] double mean() const noexcept;

 private:
  mutable std::vector<double> values_;
  mutable bool sorted_ = true;
};

/// What the figures were measured on.
struct Subject {
  std::string benchmark;
  std::string model;  ///< file or generator, with its seed
  std::uint64_t digest = 0;
  std::uint32_t faces = 0;  ///< 0: not about a model
  std::string settings;     ///< radius, speed, budget: whatever the figures depend on
};

class Report {
 public:
  explicit Report(Subject subject) : subject_{std::move(subject)} {}

  /// A line with n, p50, p99, p99.9 and max. `unit` is that of the samples.
  void row(const std::string& name, const std::string& population, const std::string& unit, const Samples& samples);
  /// A single number.
  void figure(const std::string& name, const std::string& population, const std::string& unit, double value);
  /// A line of plain text, before the bounds.
  void note(std::string text) { notes_.push_back(std::move(text)); }
  /// A figure that has to be `limit` at most, or at least.
  void at_most(const std::string& what, const std::string& population, const std::string& unit, double value,
               double limit);
  void at_least(const std::string& what, const std::string& population, const std::string& unit, double value,
                double limit);

  /// Prints everything to standard output and writes `json` unless that is empty. 0 when all bounds hold, else 1.
  /// Throws std::runtime_error when the file cannot be written.
  [[nodiscard]] int finish(const std::string& json) const;

 private:
  struct Row {
    std::string name, population, unit;
    std::size_t count;
    double p50, p99, p999, max;
  };
  struct Figure {
    std::string name, population, unit;
    double value;
  };
  struct Bound {
    std::string what, population, unit;
    double value, limit;
    bool upper;
    [[nodiscard]] bool holds() const noexcept { return upper ? value <= limit : value >= limit; }
  };

  void print() const;
  void write(const std::string& json) const;

  Subject subject_;
  std::vector<Row> rows_;
  std::vector<Figure> figures_;
  std::vector<std::string> notes_;
  std::vector<Bound> bounds_;
};

}  // namespace tactus::bench
