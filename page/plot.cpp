#include "page/plot.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "page/page.hpp"

namespace tactus::page {
namespace {

constexpr double kWidth = 860, kHeight = 340, kLeft = 64, kRight = 32, kTop = 14, kBottom = 40;
constexpr char kGrey[] = "#a0aec0";

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

std::string coordinate(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

}  // namespace

Plot::Plot(const Scale& scale) : scale_{scale}, low_{scale.low}, high_{scale.high} {
  svg_ << "<svg viewBox=\"0 0 " << kWidth << ' ' << kHeight << "\" role=\"img\">\n";
  if (scale_.logarithmic) {
    low_ = std::floor(std::log10(scale.low) * 3) / 3;
    high_ = std::max(low_ + 0.5, std::log10(scale.high) + 0.05);
    for (int decade = static_cast<int>(std::floor(low_)); decade <= high_; ++decade)
      for (const int digit : {1, 2, 5}) grid_line(digit * std::pow(10.0, decade));
  } else {
    if (!(high_ > low_)) high_ = low_ + 1;
    const double rough = (high_ - low_) / 5, decade = std::pow(10.0, std::floor(std::log10(rough)));
    const double step = decade * (rough > 5 * decade ? 10 : rough > 2 * decade ? 5 : 2);
    high_ = step * std::ceil(high_ / step);
    for (double value = step * std::floor(low_ / step); value < high_ + step / 2; value += step) grid_line(value);
  }
}

void Plot::grid_line(double value) {
  const double at = scale_.logarithmic ? std::log10(value) : value;
  if (at < low_ || at > high_ + 1e-9) return;
  line(kLeft, y(value), kWidth - kRight, y(value), kGrey, 0.3);
  text(kLeft - 6, y(value) + 4, "end", scale_.label != nullptr ? scale_.label(value) : number(value));
}

double Plot::x(double share) { return kLeft + share * (kWidth - kLeft - kRight); }

double Plot::y(double value) const {
  const double at = scale_.logarithmic ? std::log10(std::max(value, 1e-300)) : value;
  return kHeight - kBottom - std::clamp((at - low_) / (high_ - low_), 0.0, 1.0) * (kHeight - kTop - kBottom);
}

void Plot::tick(double share, const std::string& label) {
  line(x(share), kTop, x(share), kHeight - kBottom, kGrey, 0.3);
  text(x(share), kHeight - kBottom + 18, "middle", label);
}

void Plot::caption(const std::string& label) { text((kLeft + kWidth) / 2, kHeight - 4, "middle", label); }

void Plot::curve(const std::vector<std::pair<double, double>>& points, const std::string& colour, double width,
                 bool dashed) {
  svg_ << "<polyline fill=\"none\" stroke=\"" << colour << "\" stroke-width=\"" << width << '"'
       << (dashed ? " stroke-dasharray=\"5 4\"" : "") << " points=\"";
  for (const auto& [share, value] : points) svg_ << coordinate(x(share)) << ',' << coordinate(y(value)) << ' ';
  svg_ << "\"/>\n";
}

void Plot::bar(double share, double low, double high, const std::string& colour) {
  line(x(share), y(low), x(share), y(high), colour, 1);
}

void Plot::mark(double share, const std::string& colour) {
  line(x(share), kHeight - kBottom, x(share), kHeight - kBottom - 9, colour, 1.5);
}

std::string Plot::svg() const { return svg_.str() + "</svg>\n"; }

void Plot::line(double x1, double y1, double x2, double y2, const std::string& colour, double width) {
  svg_ << "<line x1=\"" << x1 << "\" y1=\"" << y1 << "\" x2=\"" << x2 << "\" y2=\"" << y2 << "\" stroke=\"" << colour
       << "\" stroke-width=\"" << width << "\"/>\n";
}

void Plot::text(double at_x, double at_y, const char* anchor, const std::string& label) {
  svg_ << "<text x=\"" << at_x << "\" y=\"" << at_y << "\" text-anchor=\"" << anchor << "\">" << escaped(label)
       << "</text>\n";
}

}  // namespace tactus::page
