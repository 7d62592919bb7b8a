#include "study/statistics.hpp"

#include <algorithm>
#include <numeric>
#include <random>

#include "session/percentile.hpp"

namespace tactus::study {
namespace {

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace

Estimate estimate(const std::vector<double>& values) {
  if (values.empty()) return {};
  constexpr std::size_t kDraws = 2000;
  Estimate result;
  result.count = values.size();
  result.mean = result.low = result.high = mean_of(values);
  if (values.size() == 1) return result;
  std::mt19937_64 random{1};
  std::vector<double> means(kDraws), drawn(values.size());
  for (double& mean : means) {
    // A distribution of the standard library would draw other values with another implementation.
    for (double& value : drawn) value = values[random() % values.size()];
    mean = mean_of(drawn);
  }
  std::sort(means.begin(), means.end());
  result.low = session::percentile(means, 0.025);
  result.high = session::percentile(means, 0.975);
  return result;
}

}  // namespace tactus::study
