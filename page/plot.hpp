/// Curves over a linear or logarithmic scale, as SVG.
#pragma once

#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace tactus::page {

/// The vertical axis.
struct Scale {
  double low = 0, high = 1;  ///< range that the axis must include; both above 0 if logarithmic
  bool logarithmic = false;
  std::string (*label)(double value) = nullptr;  ///< formats the grid labels; null: the number
};

/// Points have a position, 0 to 1 from the left, and a value; values outside the scale are drawn at its end.
class Plot {
 public:
  explicit Plot(const Scale& scale);

  /// A vertical line with a label under it.
  void tick(double share, const std::string& label);
  /// A caption below the labels.
  void caption(const std::string& text);
  void curve(const std::vector<std::pair<double, double>>& points, const std::string& colour, double width,
             bool dashed = false);
  /// A vertical line from one value to another.
  void bar(double share, double low, double high, const std::string& colour);
  /// A short line upwards from the bottom.
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
