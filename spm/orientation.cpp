#include "spm/orientation.hpp"

#include <array>
#include <cmath>

#include "spm/assert.hpp"

namespace tactus::spm {
namespace {

/// Half the distance from 1 to the next double: the maximum relative error of one rounding.
constexpr double kEpsilon = 0x1p-53;

struct TwoDoubles {
  double high, low;
};

/// Returns the exact sum; `high` is the rounded value.
TwoDoubles two_sum(double a, double b) noexcept {
  const double high = a + b;
  const double b_part = high - a;
  return {high, (a - (high - b_part)) + (b - b_part)};
}

/// Splits a double into two with at most 26 significant bits each.
TwoDoubles halves(double a) noexcept {
  constexpr double kSplitter = 0x1p27 + 1;
  const double c = kSplitter * a;
  const double high = c - (c - a);
  return {high, a - high};
}

/// Returns the exact product; `high` is the rounded value.
TwoDoubles two_product(double a, double b) noexcept {
  const double high = a * b;
  const TwoDoubles x = halves(a), y = halves(b);
  return {high, ((x.high * y.high - high) + x.high * y.low + x.low * y.high) + x.low * y.low};
}

/// An exact sum of products of doubles. It is stored as components that do not overlap, the smallest first; none is 0.
class ExactSum {
 public:
  void add(double term) noexcept {
    int size = 0;
    for (int i = 0; i < size_; ++i) {
      const TwoDoubles sum = two_sum(term, part_[i]);
      if (sum.low != 0) part_[size++] = sum.low;
      term = sum.high;
    }
    if (term != 0) part_[size++] = term;
    size_ = size;
    TACTUS_ASSERT(size_ < kMax);
  }

  void add_product(double a, double b) noexcept {
    const TwoDoubles ab = two_product(a, b);
    add(ab.low);
    add(ab.high);
  }

  void add_product(double a, double b, double c) noexcept {
    const TwoDoubles ab = two_product(a, b);
    add_product(ab.low, c);
    add_product(ab.high, c);
  }

  [[nodiscard]] int sign() const noexcept { return size_ == 0 ? 0 : part_[size_ - 1] > 0 ? 1 : -1; }

 private:
  // One component for each term: 6 products of 3 differences are 6 x 8 products of 3 doubles, with 4 terms each.
  static constexpr int kMax = 6 * 8 * 4 + 1;
  std::array<double, kMax> part_;
  int size_ = 0;
};

/// Returns the exact difference of two doubles; `high` is the rounded value.
TwoDoubles two_difference(double a, double b) noexcept { return two_sum(a, -b); }

using ExactVector = std::array<TwoDoubles, 3>;

void add_product(ExactSum& sum, double sign, TwoDoubles a, TwoDoubles b, TwoDoubles c) noexcept {
  for (const double x : {a.low, a.high})
    for (const double y : {b.low, b.high})
      for (const double z : {c.low, c.high})
        if (x != 0 && y != 0 && z != 0) sum.add_product(sign * x, y, z);
}

[[gnu::noinline]] int exact_orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) noexcept {
  ExactVector u, v, w;
  for (int i = 0; i < 3; ++i) {
    u[i] = two_difference(b[i], a[i]);
    v[i] = two_difference(c[i], a[i]);
    w[i] = two_difference(d[i], a[i]);
  }
  ExactSum sum;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    add_product(sum, 1, u[i], v[j], w[k]);
    add_product(sum, -1, u[i], v[k], w[j]);
  }
  return sum.sign();
}

[[gnu::noinline]] int exact_orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, int x, int y) noexcept {
  const TwoDoubles ux = two_difference(b[x], a[x]), uy = two_difference(b[y], a[y]);
  const TwoDoubles vx = two_difference(c[x], a[x]), vy = two_difference(c[y], a[y]);
  ExactSum sum;
  const auto add = [&](double sign, TwoDoubles p, TwoDoubles q) noexcept {
    for (const double s : {p.low, p.high})
      for (const double t : {q.low, q.high})
        if (s != 0 && t != 0) sum.add_product(sign * s, t);
  };
  add(1, ux, vy);
  add(-1, uy, vx);
  return sum.sign();
}

int sign_of(double value) noexcept { return value > 0 ? 1 : -1; }

}  // namespace

int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) noexcept {
  const Vec3d u = b - a, v = c - a, w = d - a;
  double determinant = 0, abs_sum = 0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const double first = v[j] * w[k], second = v[k] * w[j];
    determinant += u[i] * (first - second);
    abs_sum += std::abs(u[i]) * (std::abs(first) + std::abs(second));
  }
  constexpr double kBound = (7 + 56 * kEpsilon) * kEpsilon;  // o3derrboundA of Shewchuk
  return std::abs(determinant) > kBound * abs_sum ? sign_of(determinant) : exact_orientation(a, b, c, d);
}

int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, int x, int y) noexcept {
  const double first = (b[x] - a[x]) * (c[y] - a[y]), second = (b[y] - a[y]) * (c[x] - a[x]);
  constexpr double kBound = (3 + 16 * kEpsilon) * kEpsilon;  // ccwerrboundA of Shewchuk
  return std::abs(first - second) > kBound * (std::abs(first) + std::abs(second)) ? sign_of(first - second)
                                                                                  : exact_orientation(a, b, c, x, y);
}

}  // namespace tactus::spm
