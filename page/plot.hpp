/// Draws curves as SVG, with a linear or logarithmic vertical axis.
#pragma once

#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace tactus::page {

/// The vertical axis.
struct Scale {
  double low = 0, high = 1;  ///< range that the axis must include; both above 0 if `logarithmic`
  bool logarithmic = false;
  std::string (*label)(double value) = nullptr;  ///< makes the label of a grid line; null: the label is the number
};

/// A plot to which curves and marks are added. A point has a horizontal position `share`, from 0 (left) to 1 (right),
/// and a value. A value outside the scale is drawn at the nearer end of the axis.
class Plot {
 public:
  explicit Plot(const Scale& scale);

  /// Adds a vertical grid line with a label below it.
  void tick(double share, const std::string& label);
  /// Adds a caption below the labels.
  void caption(const std::string& text);
  /// Adds a line through points (share, value). `width`: line width, on a plot 860 units wide.
  void curve(const std::vector<std::pair<double, double>>& points, const std::string& colour, double width,
             bool dashed = false);
  /// Adds a vertical line from value `low` to value `high`.
  void bar(double share, double low, double high, const std::string& colour);
  /// Adds a short line upwards from the bottom.
  void mark(double share, const std::string& colour);
  /// Returns the plot as an SVG element.
  [[nodiscard]] std::string svg() const;

 private:
  [[nodiscard]] static double x(double share);
  [[nodiscard]] double y(double value) const;
  void line(double x1, double y1, double x2, double y2, const std::string& colour, double width);
  void text(double at_x, double at_y, const char* anchor, const std::string& label);
  void grid_line(double value);

  Scale scale_;
  double low_, high_;  // values at the ends of the axis, or their decimal logarithms
  std::ostringstream svg_;
};

}  // namespace tactus::page
