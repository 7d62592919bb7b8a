#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "latency/report.hpp"

namespace tactus::latency {
namespace {

constexpr double kWidth = 860, kHeight = 340, kLeft = 64, kRight = 32, kTop = 14, kBottom = 40;
constexpr std::array kColours{"#2b6cb0", "#c05621", "#2f855a", "#9b2c2c", "#6b46c1", "#b7791f", "#0987a0", "#97266d"};

constexpr char kHead[] = R"(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>tactus-latency</title>
<style>
body{font:15px/1.45 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#1a202c;background:#fff}
h1{font-size:1.4rem}h2{font-size:1.1rem;margin-top:2.2rem}code{font-size:.85rem;word-break:break-all}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.82rem;font-variant-numeric:tabular-nums}
th,td{padding:.2rem .5rem;text-align:right;border-bottom:1px solid #cbd5e0;white-space:nowrap}
th:first-child,td:first-child{text-align:left}svg{width:100%;height:auto}svg text{font:12px system-ui,sans-serif;fill:#4a5568}
.key span{display:inline-block;width:1.2rem;height:.2rem;vertical-align:middle;margin-right:.4rem}.key div{font-size:.85rem}
@media (prefers-color-scheme:dark){body{color:#e2e8f0;background:#171c26}svg text{fill:#a0aec0}th,td{border-color:#2d3748}}
</style></head><body>
)";

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '&')
      out += "&amp;";
    else if (c == '"')
      out += "&quot;";
    else
      out += c;
  }
  return out;
}

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

/// A plot whose vertical axis is logarithmic, in microseconds.
class Plot {
 public:
  Plot(double low_us, double high_us)
      : low_{std::floor(std::log10(std::max(low_us, 0.1)) * 3) / 3},
        high_{std::max(low_ + 0.5, std::log10(std::max(high_us, 1.0)) + 0.05)} {
    svg_ << "<svg viewBox=\"0 0 " << kWidth << ' ' << kHeight << "\" role=\"img\">\n";
    for (int decade = static_cast<int>(std::floor(low_)); decade <= high_; ++decade) {
      for (const int digit : {1, 2, 5}) {
        const double us = digit * std::pow(10.0, decade);
        if (std::log10(us) < low_ || std::log10(us) > high_) continue;
        line(kLeft, y(us), kWidth - kRight, y(us), "#a0aec0", 0.3);
        text(kLeft - 6, y(us) + 4, "end", with_unit(us));
      }
    }
  }
  /// `share` of the width.
  [[nodiscard]] static double x(double share) { return kLeft + share * (kWidth - kLeft - kRight); }
  [[nodiscard]] double y(double us) const {
    const double share = (std::log10(std::max(us, 1e-3)) - low_) / (high_ - low_);
    return kHeight - kBottom - std::clamp(share, 0.0, 1.0) * (kHeight - kTop - kBottom);
  }
  void tick(double share, const std::string& label) {
    line(x(share), kTop, x(share), kHeight - kBottom, "#a0aec0", 0.3);
    text(x(share), kHeight - kBottom + 18, "middle", label);
  }
  void caption(const std::string& label) { text((kLeft + kWidth) / 2, kHeight - 4, "middle", label); }
  void curve(const std::vector<std::pair<double, double>>& points, const std::string& colour, double width) {
    svg_ << "<polyline fill=\"none\" stroke=\"" << colour << "\" stroke-width=\"" << width << "\" points=\"";
    for (const auto& [share, us] : points) svg_ << number(x(share)) << ',' << number(y(us)) << ' ';
    svg_ << "\"/>\n";
  }
  void mark(double share, const std::string& colour) {
    line(x(share), kHeight - kBottom, x(share), kHeight - kBottom - 9, colour, 1.5);
  }
  [[nodiscard]] std::string finish() const { return svg_.str() + "</svg>\n"; }

 private:
  void line(double x1, double y1, double x2, double y2, const std::string& colour, double width) {
    svg_ << "<line x1=\"" << x1 << "\" y1=\"" << y1 << "\" x2=\"" << x2 << "\" y2=\"" << y2 << "\" stroke=\"" << colour
         << "\" stroke-width=\"" << width << "\"/>\n";
  }
  void text(double at_x, double at_y, const char* anchor, const std::string& label) {
    svg_ << "<text x=\"" << at_x << "\" y=\"" << at_y << "\" text-anchor=\"" << anchor << "\">" << escaped(label)
         << "</text>\n";
  }

  double low_, high_;  // logarithms of us
  std::ostringstream svg_;
};

/// Smallest and largest half round trip of all that is drawn.
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
  Plot plot{low, high};
  const double last = -std::log10(1 - curve_shares().back());
  const std::array<const char*, 5> names{"min", "90 %", "99 %", "99.9 %", "99.99 %"};
  for (std::size_t i = 0; i < names.size(); ++i) plot.tick(static_cast<double>(i) / last, names[i]);
  plot.tick(std::log10(2.0) / last, "50 %");
  plot.caption("share of echoes that took no longer");
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (results[i].half_round_trip.count == 0) continue;
    std::vector<std::pair<double, double>> points;
    for (std::size_t k = 0; k < curve_shares().size(); ++k)
      points.emplace_back(-std::log10(1 - curve_shares()[k]) / last, results[i].curve[k]);
    plot.curve(points, kColours[i % kColours.size()], 1.8);
  }
  return plot.finish();
}

std::string over_time(const Result& result, const std::string& colour) {
  Plot plot{result.curve.empty() ? 1 : result.curve.front(), result.half_round_trip.max};
  std::vector<std::pair<double, double>> medians, maxima;
  const auto count = static_cast<double>(result.moments.size());
  for (std::size_t i = 0; i < result.moments.size(); ++i) {
    const Moment& moment = result.moments[i];
    const double share = (static_cast<double>(i) + 0.5) / count;
    if (moment.missing > 0) plot.mark(share, "#e53e3e");
    if (moment.max_us <= 0) continue;
    medians.emplace_back(share, moment.median_us);
    maxima.emplace_back(share, moment.max_us);
  }
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) plot.tick(share, number(share * result.cell.seconds) + " s");
  plot.caption("time; thick: median, thin: longest of each moment; red: an echo is missing");
  plot.curve(maxima, colour, 0.7);
  plot.curve(medians, colour, 2);
  return plot.finish();
}

}  // namespace

void write_html(const std::string& file, const Subject& subject, const std::vector<Result>& results) {
  std::ofstream out{file};
  out << kHead << "<h1>Latency</h1>\n<p><code>" << escaped(subject.command) << "</code><br>" << escaped(subject.machine)
      << "; tactus " << escaped(subject.build) << "</p>\n"
      << "<p>Times in microseconds, from when a ping was to be sent. Half round trip over the echoes of all readers; "
         "age one way, "
         "right to the bound beside it (0: both sides read one clock).</p>\n<div class=\"wide\"><table>\n"
         "<tr><th>test</th><th colspan=\"5\">half round trip: p50, p90, p99, p99.9, max</th><th colspan=\"4\">age: "
         "p50, p99, max, "
         "bound</th><th>jitter</th><th>lost %</th><th>reordered</th><th>duplicates</th><th>mesh MB/s</th></tr>\n";
  for (const Result& r : results) {
    out << "<tr><td>" << escaped(describe(r.cell)) << "</td>";
    const Summary& h = r.half_round_trip;
    for (const double value :
         {h.p50, h.p90, h.p99, h.p999, h.max, r.age.p50, r.age.p99, r.age.max, r.clock_bound_us, r.jitter_us})
      out << "<td>" << number(value) << "</td>";
    char text[96];
    std::snprintf(text, sizeof text, "<td>%.3f</td><td>%llu</td><td>%llu</td><td>%.2f</td></tr>\n",
                  r.expected > 0 ? 100.0 * static_cast<double>(r.lost) / static_cast<double>(r.expected) : 0.0,
                  static_cast<unsigned long long>(r.reordered), static_cast<unsigned long long>(r.duplicates),
                  r.load_mbyte_per_s);
    out << text;
  }
  out << "</table></div>\n<h2>Distribution of the half round trip</h2>\n"
      << distributions(results) << "<div class=\"key\">\n";
  for (std::size_t i = 0; i < results.size(); ++i)
    out << "<div><span style=\"background:" << kColours[i % kColours.size()] << "\"></span>"
        << escaped(describe(results[i].cell)) << "</div>\n";
  out << "</div>\n";
  for (std::size_t i = 0; i < results.size(); ++i)
    out << "<h2>" << escaped(describe(results[i].cell)) << "</h2>\n"
        << over_time(results[i], kColours[i % kColours.size()]);
  out << "</body></html>\n";
  out.close();
  if (!out) throw LatencyError(file + ": cannot be written");
}

}  // namespace tactus::latency
