/// Curves over a linear or logarithmic scale, as SVG.
#pragma once

#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace tactus::page {

/// The vertical axis.
struct Scale {
  double low = 0, high = 1;  ///< what must be on it; both above 0 on a logarithmic one
  bool logarithmic = false;
  std::string (*label)(double value) = nullptr;  ///< of its lines; null: the number
};

/// Points are a share of the width from the left, 0 to 1, and a value; what is off the scale is drawn at its end.
class Plot {
 public:
  explicit Plot(const Scale& scale);

  /// A vertical line with a label under it.
  void tick(double share, const std::string& label);
  /// Under the labels.
  void caption(const std::string& text);
  void curve(const std::vector<std::pair<double, double>>& points, const std::string& colour, double width,
             bool dashed = false);
  /// A vertical line from one value to another.
  void bar(double share, double low, double high, const std::string& colour);
  /// A short line up from the bottom.
  void mark(double share, const std::string& colour);
  [[nodiscard]] std::string svg() const;

 private:
  [[nodiscard]] static double x(double share);
  [[nodiscard]] double y(double value) const;
  void line(double x1, double y1, double x2, double y2, const std::string& colour, double width);
  void text(double at_x, double at_y, const char* anchor, const std::string& label);
  void level(double value);

  Scale scale_;
  double low_, high_;  // of the scale, or their logarithms
  std::ostringstream svg_;
};

}  // namespace tactus::page
