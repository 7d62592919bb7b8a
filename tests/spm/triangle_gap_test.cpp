// Compares gaps between triangles, computed in lanes of floats, with a computation in double precision. Compares the
// near pairs of a probe with a search of all pairs.

#include "spm/triangle_gap.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <utility>

#include "spm/mesh_probe.hpp"
#include "spm/offline/generate.hpp"
#include "spm/triangle.hpp"
#include "tests/support/shown_mesh.hpp"

namespace tactus::spm {
namespace {

/// Returns the distance of two segments, which is at an end of one segment or at the stationary point inside both.
double segment_distance(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  const auto to_segment = [](const Vec3d& p, const Vec3d& from, const Vec3d& to) {
    const Vec3d segment = to - from;
    const double squared_length = segment.squaredNorm();
    const double t = squared_length > 0 ? std::clamp(segment.dot(p - from) / squared_length, 0.0, 1.0) : 0;
    return (from + t * segment - p).norm();
  };
  double min = std::min({to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)});
  const Vec3d u = b - a, v = d - c, w = a - c;
  const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), denominator = uu * vv - uv * uv;
  if (!(denominator > 1e-12 * uu * vv)) return min;
  const double s = (uv * v.dot(w) - vv * u.dot(w)) / denominator, t = (uu * v.dot(w) - uv * u.dot(w)) / denominator;
  if (s >= 0 && s <= 1 && t >= 0 && t <= 1) min = std::min(min, (w + s * u - t * v).norm());
  return min;
}

double triangle_distance(const Triangle3d& f, const Triangle3d& g) {
  double min = 1e300;
  for (int i = 0; i < 3; ++i) {
    min = std::min(min, std::sqrt(closest_point(g[i], f[0], f[1], f[2]).squared_distance));
    min = std::min(min, std::sqrt(closest_point(f[i], g[0], g[1], g[2]).squared_distance));
    for (int j = 0; j < 3; ++j) min = std::min(min, segment_distance(f[i], f[(i + 1) % 3], g[j], g[(j + 1) % 3]));
  }
  return min;
}

Triangle3d lane_of(const TriangleLanes& lanes, unsigned lane) {
  Triangle3d t;
  for (int i = 0; i < 3; ++i)
    for (int axis = 0; axis < 3; ++axis) t[i][axis] = lanes.corner[i][axis][lane];
  return t;
}

/// `kind`: 0 any triangles, 1 needles, 2 segments, 3 corners on a coarse grid, so that many coincide,
/// 4 triangles in the plane z = `offset`.
TriangleLanes random_triangles(std::mt19937_64& random, int kind, double offset) {
  std::uniform_real_distribution<double> coordinate{-1, 1};
  TriangleLanes lanes;
  for (unsigned lane = 0; lane < 8; ++lane)
    for (int i = 0; i < 3; ++i)
      for (int axis = 0; axis < 3; ++axis) {
        double x = coordinate(random) + (axis == 2 ? offset : 0);
        if (kind == 1 && i == 2) x = lanes.corner[0][axis][lane] + 1e-4 * coordinate(random);
        if (kind == 2 && i > 0) x = lanes.corner[0][axis][lane] + (axis == 0 ? static_cast<float>(i) : 0);
        if (kind == 3) x = std::round(2 * x) / 2;
        if (kind == 4 && axis == 2) x = offset;
        lanes.corner[i][axis][lane] = static_cast<float>(x);
      }
  return lanes;
}

TEST(TriangleGap, IsTheDistanceOfTheNearestPointsUnlessTheTrianglesMayIntersect) {
  std::mt19937_64 random{7};
  std::size_t compared = 0, intersecting = 0;
  for (int round = 0; round < 4000; ++round) {
    const double offset = round % 3 == 0 ? 0 : round % 3 == 1 ? 0.5 : 2.5;
    const TriangleLanes f = random_triangles(random, round % 5, 0), g = random_triangles(random, round / 5 % 5, offset);
    TriangleGaps gap;
    gaps(f, g, gap, best_simd());
    for (unsigned lane = 0; lane < 8; ++lane) {
      const Triangle3d ft = lane_of(f, lane), gt = lane_of(g, lane);
      const double expected = triangle_distance(ft, gt);
      PairContact contact;
      if (intersect(ft, gt, contact)) {
        // Rounding can leave a tiny gap between intersecting triangles.
        ASSERT_TRUE((gap.may_intersect >> lane & 1u) != 0 || gap.distance[lane] < 1e-5) << round << ' ' << lane;
        ++intersecting;
        continue;
      }
      ++compared;
      ASSERT_NEAR(gap.distance[lane], expected, 5e-6) << round << ' ' << lane;
      const Vec3d on_f{gap.on_object[0][lane], gap.on_object[1][lane], gap.on_object[2][lane]};
      const Vec3d on_g{gap.on_probe[0][lane], gap.on_probe[1][lane], gap.on_probe[2][lane]};
      ASSERT_LT(closest_point(on_f, ft[0], ft[1], ft[2]).squared_distance, 1e-10) << round << ' ' << lane;
      ASSERT_LT(closest_point(on_g, gt[0], gt[1], gt[2]).squared_distance, 1e-10) << round << ' ' << lane;
      ASSERT_NEAR((on_g - on_f).norm(), gap.distance[lane], 1e-6) << round << ' ' << lane;
    }
  }
  EXPECT_GT(compared, 10000u);
  EXPECT_GT(intersecting, 1000u);
}

TEST(TriangleGap, IsTheSameForEveryInstructionSet) {
  std::mt19937_64 random{8};
  for (int round = 0; round < 500; ++round) {
    const TriangleLanes f = random_triangles(random, round % 5, 0), g = random_triangles(random, round / 5 % 5, 0.3);
    TriangleGaps a, b;
    gaps(f, g, a, Simd::kBase);
    gaps(f, g, b, best_simd());
    ASSERT_EQ(a.may_intersect, b.may_intersect);
    for (unsigned lane = 0; lane < 8; ++lane) ASSERT_EQ(a.distance[lane], b.distance[lane]);
  }
}

TEST(NearPairs, IncludeAllPairsWithinTheMarginInAnyPoseAndScale) {
  const offline::TriangleMesh organ = offline::generate(offline::Shape::kOrgan, 4000);
  const test_support::ShownMesh shown{organ};
  const offline::TriangleMesh stylus = offline::stylus();
  std::mt19937_64 random{9};
  std::normal_distribution<double> normal;
  std::vector<NearPairs> pairs(4096);
  std::size_t near = 0, returned = 0;
  for (int round = 0; round < 10; ++round) {
    const double scale = round % 2 == 0 ? 1 : 3.5;  // object units in a probe unit
    offline::TriangleMesh tool = stylus;
    for (auto& p : tool.positions)
      for (float& x : p) x = static_cast<float>(x / scale);
    const MeshProbe probe{tool.positions, tool.faces};
    PlacedProbe placed{probe};
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::Quaterniond{normal(random), normal(random), normal(random), normal(random)}
                        .normalized()
                        .toRotationMatrix();
    const auto& p = organ.positions[random() % organ.positions.size()];
    pose.translation() = Vec3d{p[0], p[1], p[2]} + 0.003 * Vec3d{normal(random), normal(random), normal(random)};
    placed.set_pose(pose, scale);
    for (const double margin : {0.0001, 0.001}) {
      const MeshQueryResult touch = placed.find_near_pairs(shown.tree(), margin, pairs.data(), 8 * 4096);
      ASSERT_TRUE(touch.complete);
      std::set<std::pair<std::uint32_t, std::uint32_t>> found;
      for (std::uint32_t i = 0; i < touch.contacts; ++i)
        found.emplace(index(pairs[i / 8].face[i % 8]), probe.number(pairs[i / 8].triangle[i % 8]));
      returned += found.size();
      for (const LeafLane at : shown.tree().shown()) {
        const Triangle3d face = shown.triangle(at);
        if ((face[0] - pose.translation()).norm() > 0.04) continue;
        for (std::uint32_t t = 0; t < probe.triangles(); ++t) {
          const Triangle3d triangle = placed.triangle(t);
          const double size = std::max({(triangle[0] - triangle[1]).norm(), (triangle[0] - triangle[2]).norm()});
          if ((face[0] - triangle[0]).norm() > size + 0.01) continue;
          PairContact contact;
          if (triangle_distance(face, triangle) > margin * (1 - 1e-6) && !intersect(face, triangle, contact)) continue;
          ++near;
          ASSERT_EQ(found.count({index(shown.tree().face(at)), t}), 1u) << "round " << round << ", margin " << margin;
        }
      }
    }
  }
  EXPECT_GT(near, 1000u);
  EXPECT_LT(returned, 8 * near) << "too many pairs are not near";
}

}  // namespace
}  // namespace tactus::spm
