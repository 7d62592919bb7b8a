/// Mean and confidence interval over the seeds of a cell.
#pragma once

#include <cstddef>
#include <vector>

namespace tactus::study {

struct Estimate {
  double mean = 0;
  double low = 0, high = 0;  ///< 95 % confidence; both equal the mean for a single value
  std::size_t count = 0;
};

/// Percentile bootstrap: means of 2000 samples drawn from `values` with replacement, their 2.5th and 97.5th percentile.
/// The same values give the same bits. Source: Efron 1979.
[[nodiscard]] Estimate estimate(const std::vector<double>& values);

}  // namespace tactus::study
