#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "latency/report.hpp"
#include "page/page.hpp"
#include "page/plot.hpp"

namespace tactus::latency {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, value < 100 ? "%.1f" : "%.0f", value);
  return text;
}

std::string with_unit(double us) {
  const auto [value, unit] = us >= 1e6   ? std::pair{us * 1e-6, "s"}
                             : us >= 1e3 ? std::pair{us * 1e-3, "ms"}
                                         : std::pair{us, "us"};
  char text[32];
  std::snprintf(text, sizeof text, "%g %s", value, unit);
  return text;
}

/// Returns an empty plot with a logarithmic axis for times from `low_us` to `high_us`.
page::Plot empty_plot(double low_us, double high_us) {
  return page::Plot{{std::max(low_us, 0.1), std::max(high_us, 1.0), true, with_unit}};
}

/// Returns the smallest and the largest half round trip of all results, us; 0 and 0 without an echo.
std::pair<double, double> range(const std::vector<Result>& results) {
  double low = 1e9, high = 0;
  for (const Result& r : results) {
    if (r.half_round_trip.count == 0) continue;
    low = std::min(low, r.curve.front());
    high = std::max(high, r.half_round_trip.max);
  }
  return {std::min(low, high), high};
}

std::string distributions(const std::vector<Result>& results) {
  const auto [low, high] = range(results);
  page::Plot plot = empty_plot(low, high);
  const double last = -std::log10(1 - quantile_shares().back());
  const std::array<const char*, 5> names{"min", "90 %", "99 %", "99.9 %", "99.99 %"};
  for (std::size_t i = 0; i < names.size(); ++i) plot.tick(static_cast<double>(i) / last, names[i]);
  plot.tick(std::log10(2.0) / last, "50 %");
  plot.caption("share of echoes with at most this half round trip");
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (results[i].half_round_trip.count == 0) continue;
    std::vector<std::pair<double, double>> points;
    for (std::size_t k = 0; k < quantile_shares().size(); ++k)
      points.emplace_back(-std::log10(1 - quantile_shares()[k]) / last, results[i].curve[k]);
    plot.curve(points, page::colour(i), 1.8);
  }
  return plot.svg();
}

std::string plot_over_time(const Result& result, const std::string& colour) {
  const auto [low, high] = range({result});
  page::Plot plot = empty_plot(low, high);
  std::vector<std::pair<double, double>> medians, maxima;
  const auto count = static_cast<double>(result.bins.size());
  for (std::size_t i = 0; i < result.bins.size(); ++i) {
    const TimeBin& bin = result.bins[i];
    const double share = (static_cast<double>(i) + 0.5) / count;
    if (bin.missing > 0) plot.mark(share, "#e53e3e");
    if (!(bin.max_us > 0)) continue;  // NaN: nothing arrived
    medians.emplace_back(share, bin.median_us);
    maxima.emplace_back(share, bin.max_us);
  }
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) plot.tick(share, number(share * result.evaluated_s) + " s");
  plot.caption("time after the warm-up; thick: median, thin: maximum of each interval; red: an echo is missing");
  plot.curve(maxima, colour, 0.7);
  plot.curve(medians, colour, 2);
  return plot.svg();
}

}  // namespace

void write_html(const std::string& file, const RunInfo& info, const std::vector<Result>& results) {
  using page::escaped;
  std::ostringstream body;
  body << "<h1>Latency</h1>\n<p><code>" << escaped(info.command) << "</code><br>" << escaped(info.machine)
       << "; tactus " << escaped(info.build) << "</p>\n"
       << "<p>Times in microseconds, from the intended time of a ping. Half round trip: of the echoes of all readers. "
          "Age: one-way time to all readers. Bound: error bound of the age; 0 if both sides read one clock.</p>\n"
          "<div class=\"wide\"><table>\n<tr><th>test</th>"
          "<th colspan=\"5\">half round trip: p50, p90, p99, p99.9, max</th>"
          "<th colspan=\"4\">age: p50, p99, max, bound</th><th>jitter</th><th>lost %</th><th>reordered</th>"
          "<th>duplicates</th><th>mesh MB/s</th></tr>\n";
  for (const Result& r : results) {
    body << "<tr><td>" << escaped(describe(r.test)) << "</td>";
    const Summary& h = r.half_round_trip;
    for (const double value :
         {h.p50, h.p90, h.p99, h.p999, h.max, r.age.p50, r.age.p99, r.age.max, r.clock_bound_us, r.jitter_us})
      body << "<td>" << number(value) << "</td>";
    char text[96];
    std::snprintf(text, sizeof text, "<td>%.3f</td><td>%llu</td><td>%llu</td><td>%.2f</td></tr>\n",
                  r.expected > 0 ? 100.0 * static_cast<double>(r.lost) / static_cast<double>(r.expected) : 0.0,
                  static_cast<unsigned long long>(r.reordered), static_cast<unsigned long long>(r.duplicates),
                  r.load_mbyte_per_s);
    body << text;
  }
  body << "</table></div>\n<h2>Distribution of the half round trip</h2>\n" << distributions(results);
  std::vector<std::string> names;
  for (const Result& r : results) names.push_back(describe(r.test));
  body << page::legend(names);
  for (std::size_t i = 0; i < results.size(); ++i)
    body << "<h2>" << escaped(names[i]) << "</h2>\n" << plot_over_time(results[i], page::colour(i));
  std::ofstream out{file};
  out << page::page("tactus-latency", body.str());
  out.close();
  if (!out) throw LatencyError(file + ": cannot be written");
}

}  // namespace tactus::latency
