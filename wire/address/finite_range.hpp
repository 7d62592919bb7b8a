/// Checks for command-line options that are floating-point numbers. Header only, for a `main` that uses CLI11.
///
/// CLI11 reads `nan` and `inf` as numbers, and its CLI::Range accepts NaN. These checks accept finite numbers only.
#pragma once

#include <CLI/CLI.hpp>
#include <cmath>
#include <limits>
#include <sstream>
#include <string>

namespace tactus::wire {

/// Accepts a finite number for which `is_valid(number)` holds. `expected` is for the message, `description` for --help.
template <class IsValid>
[[nodiscard]] CLI::Validator finite_check(IsValid is_valid, const std::string& expected,
                                          const std::string& description) {
  return CLI::Validator{[is_valid, expected](std::string& text) {
                          double number = 0;
                          if (CLI::detail::lexical_cast(text, number) && std::isfinite(number) && is_valid(number))
                            return std::string{};
                          return "Value " + text + " not " + expected;
                        },
                        description};
}

/// Accepts a number from `min` to `max`, which are finite.
[[nodiscard]] inline CLI::Validator finite_range(double min, double max) {
  std::ostringstream expected, description;
  expected << "in range " << min << " to " << max;
  description << "FLOAT in [" << min << " - " << max << "]";
  return finite_check([min, max](double number) { return number >= min && number <= max; }, expected.str(),
                      description.str());
}

/// Accepts a number above 0.
[[nodiscard]] inline CLI::Validator finite_positive() {
  return finite_check([](double number) { return number >= std::numeric_limits<double>::min(); },
                      "a finite number above 0", "POSITIVE");
}

/// Accepts a number of at least 0.
[[nodiscard]] inline CLI::Validator finite_non_negative() {
  return finite_check([](double number) { return number >= 0; }, "a finite number of at least 0", "NONNEGATIVE");
}

/// Accepts every finite number.
[[nodiscard]] inline CLI::Validator finite_number() {
  return finite_check([](double) { return true; }, "a finite number", "");
}

}  // namespace tactus::wire
