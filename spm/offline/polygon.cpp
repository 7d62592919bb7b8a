#include "spm/offline/polygon.hpp"

#include <cmath>

#include "spm/model.hpp"

namespace tactus::spm::offline {
namespace {

using Point2 = std::array<double, 2>;

/// Twice the signed area of the triangle; positive if a, b, c are counter-clockwise.
double signed_area2(const Point2& a, const Point2& b, const Point2& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/// Projects the polygon along the axis nearest to its normal, so that the result is counter-clockwise.
std::vector<Point2> flattened(const std::vector<std::array<float, 3>>& corners) {
  Vec3d normal = Vec3d::Zero();  // Newell's method: a sum over the edges
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const std::array<float, 3>&a = corners[i], &b = corners[(i + 1) % corners.size()];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t next = (axis + 1) % 3, last = (axis + 2) % 3;
      normal[static_cast<int>(axis)] += (double{a[next]} - b[next]) * (double{a[last]} + b[last]);
    }
  }
  int dropped = 0;
  normal.cwiseAbs().maxCoeff(&dropped);
  auto first = static_cast<std::size_t>(dropped + 1) % 3, second = static_cast<std::size_t>(dropped + 2) % 3;
  if (normal[dropped] < 0) std::swap(first, second);
  std::vector<Point2> flat;
  for (const std::array<float, 3>& p : corners) flat.push_back({p[first], p[second]});
  return flat;
}

class Cutter {
 public:
  explicit Cutter(const std::vector<std::array<float, 3>>& corners) : at_{flattened(corners)} {
    for (std::uint32_t i = 0; i < at_.size(); ++i) left_.push_back(i);
  }

  std::vector<std::array<std::uint32_t, 3>> run() {
    std::size_t i = 0, tried = 0;
    while (left_.size() > 3) {
      i %= left_.size();
      // A polygon without ear has no area or crosses itself, so no cut is better than another.
      if (tried < left_.size() && !is_ear(i)) {
        ++i;
        ++tried;
        continue;
      }
      cut_.push_back({before(i), left_[i], after(i)});
      left_.erase(left_.begin() + static_cast<std::ptrdiff_t>(i));
      tried = 0;
    }
    cut_.push_back({left_[0], left_[1], left_[2]});
    return std::move(cut_);
  }

 private:
  std::uint32_t before(std::size_t i) const { return left_[(i + left_.size() - 1) % left_.size()]; }
  std::uint32_t after(std::size_t i) const { return left_[(i + 1) % left_.size()]; }

  bool is_ear(std::size_t i) const {
    const Point2 &a = at_[before(i)], &b = at_[left_[i]], &c = at_[after(i)];
    if (!(signed_area2(a, b, c) > 0)) return false;
    for (const std::uint32_t k : left_) {
      const Point2& p = at_[k];
      if (p == a || p == b || p == c) continue;
      if (signed_area2(a, b, p) >= 0 && signed_area2(b, c, p) >= 0 && signed_area2(c, a, p) >= 0) return false;
    }
    return true;
  }

  std::vector<Point2> at_;
  std::vector<std::uint32_t> left_;
  std::vector<std::array<std::uint32_t, 3>> cut_;
};

}  // namespace

std::vector<std::array<std::uint32_t, 3>> cut_polygon(const std::vector<std::array<float, 3>>& corners) {
  return Cutter{corners}.run();
}

}  // namespace tactus::spm::offline
