/// Mean and confidence interval of a figure over seeds.
#pragma once

#include <cstddef>
#include <vector>

namespace tactus::study {

struct Estimate {
  double mean = 0;
  double low = 0, high = 0;  ///< bounds of the 95 % confidence interval; of a single value, both are this value
  std::size_t count = 0;
};

/// Estimates the interval by the percentile bootstrap: the 2.5th and 97.5th percentile of the means of 2000 samples,
/// drawn from `values` with replacement. The same values give the same bits. Source: Efron 1979.
[[nodiscard]] Estimate estimate(const std::vector<double>& values);

}  // namespace tactus::study
