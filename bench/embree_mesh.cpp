#include "bench/embree_mesh.hpp"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace tactus::bench {

using spm::Vec3d;

namespace {

using Position = std::array<float, 3>;
using Face = std::array<std::uint32_t, 3>;
using Plane = std::array<double, 4>;  // unit normal; distance from the origin

/// Share by which float queries of a tree are larger, as coordinates were rounded from double.
constexpr double kRounding = 4e-7;

class Device {
 public:
  Device() {
    if (device_ == nullptr) throw std::runtime_error("Embree: no device");
  }
  ~Device() { rtcReleaseDevice(device_); }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  operator RTCDevice() const noexcept { return device_; }
  void check(const char* step) const {
    const RTCError error = rtcGetDeviceError(device_);
    if (error != RTC_ERROR_NONE)
      throw std::runtime_error(std::string{"Embree: "} + step + " failed with error " + std::to_string(error));
  }

 private:
  RTCDevice device_ = rtcNewDevice("threads=1");
};

/// A scene of one geometry.
class OneMesh {
 public:
  OneMesh(const Device& device, RTCGeometryType type, RTCSceneFlags flags, RTCBuildQuality quality)
      : scene{rtcNewScene(device)}, geometry{rtcNewGeometry(device, type)} {
    rtcSetSceneFlags(scene, flags | RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, quality);
  }
  ~OneMesh() {
    rtcReleaseGeometry(geometry);
    rtcReleaseScene(scene);
  }
  OneMesh(const OneMesh&) = delete;
  OneMesh& operator=(const OneMesh&) = delete;
  void build(const Device& device) {
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcCommitScene(scene);
    device.check("building a tree");
  }

  const RTCScene scene;
  const RTCGeometry geometry;
};

/// The closest point of triangle abc to p. Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.5;
/// Embree's own tutorial `closest_point` uses the same routine.
Vec3d closest_point(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) noexcept {
  const Vec3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Vec3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const Vec3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  const double scale = 1 / (va + vb + vc);
  return a + ab * (vb * scale) + ac * (vc * scale);
}

Vec3d wide(const Position& p) noexcept { return {p[0], p[1], p[2]}; }

}  // namespace

// ---- spheres

struct EmbreeMesh::Scene {
  Scene(EmbreePositions positions, EmbreeFaces triangles)
      : vertices{positions.begin(), positions.end()}, faces{triangles.begin(), triangles.end()} {
    // By copy: Embree reads 16 bytes for each vertex, beyond the last one of an array of ours.
    std::copy(vertices.begin(), vertices.end(),
              static_cast<Position*>(rtcSetNewGeometryBuffer(mesh.geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                             RTC_FORMAT_FLOAT3, sizeof(Position), vertices.size())));
    std::copy(faces.begin(), faces.end(),
              static_cast<Face*>(rtcSetNewGeometryBuffer(mesh.geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                         sizeof(Face), faces.size())));
    mesh.build(device);
  }

  Device device;
  // High quality would split triangles, and a query would find the same triangle several times.
  OneMesh mesh{device, RTC_GEOMETRY_TYPE_TRIANGLE, RTC_SCENE_FLAG_NONE, RTC_BUILD_QUALITY_MEDIUM};
  std::vector<Position> vertices;
  std::vector<Face> faces;
};

EmbreeMesh::EmbreeMesh(EmbreePositions vertices, EmbreeFaces faces)
    : scene_{std::make_unique<Scene>(vertices, faces)} {}

EmbreeMesh::~EmbreeMesh() = default;

void EmbreeMesh::touching(const Vec3d& centre, double radius, std::vector<spm::Contact>& out) const {
  struct Query {
    const Position* vertices;
    const Face* faces;
    Vec3d centre;
    double squared_radius;
    std::vector<spm::Contact>& out;
  } query{scene_->vertices.data(), scene_->faces.data(), centre, radius * radius, out};
  out.clear();
  const auto decide = [](RTCPointQueryFunctionArguments* args) {
    auto& q = *static_cast<Query*>(args->userPtr);
    const Face& face = q.faces[args->primID];
    const Vec3d point =
        closest_point(q.centre, wide(q.vertices[face[0]]), wide(q.vertices[face[1]]), wide(q.vertices[face[2]]));
    if ((q.centre - point).squaredNorm() <= q.squared_radius)
      q.out.push_back({point, spm::FaceId{args->primID}, spm::Contact::kFinest});
    return false;  // the radius stays
  };
  RTCPointQuery at{};
  at.x = static_cast<float>(centre[0]);
  at.y = static_cast<float>(centre[1]);
  at.z = static_cast<float>(centre[2]);
  at.radius = static_cast<float>(radius * (1 + 1e-6) + kRounding * centre.cwiseAbs().maxCoeff());
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(scene_->mesh.scene, &at, &context, decide, &query);
}

// ---- tools

namespace {

/// Of user geometry.
struct Triangles {
  std::vector<Position> vertices;
  std::vector<Face> faces;
  float slack = 0;  // makes boxes larger, for vertices that were rounded
};

void bounds_of(const RTCBoundsFunctionArguments* args) {
  const auto& mesh = *static_cast<const Triangles*>(args->geometryUserPtr);
  const Face& face = mesh.faces[args->primID];
  float low[3], high[3];
  for (int axis = 0; axis < 3; ++axis) {
    const auto [min, max] =
        std::minmax({mesh.vertices[face[0]][axis], mesh.vertices[face[1]][axis], mesh.vertices[face[2]][axis]});
    low[axis] = min;
    high[axis] = max;
  }
  const float more = mesh.slack;
  *args->bounds_o = {low[0] - more, low[1] - more, low[2] - more, 0, high[0] + more, high[1] + more, high[2] + more, 0};
}

void build(const Device& device, OneMesh& scene, Triangles& mesh, RTCBuildQuality quality) {
  rtcSetGeometryUserPrimitiveCount(scene.geometry, static_cast<unsigned>(mesh.faces.size()));
  rtcSetGeometryUserData(scene.geometry, &mesh);
  rtcSetGeometryBoundsFunction(scene.geometry, bounds_of, nullptr);
  rtcSetGeometryBuildQuality(scene.geometry, quality);
  scene.build(device);
}

}  // namespace

struct EmbreeTool::Scenes {
  Scenes(EmbreePositions object_vertices, EmbreeFaces object_faces, EmbreePositions tool_vertices,
         EmbreeFaces triangles)
      : object{{object_vertices.begin(), object_vertices.end()}, {object_faces.begin(), object_faces.end()}},
        tool{{tool_vertices.begin(), tool_vertices.end()}, {triangles.begin(), triangles.end()}},
        rest{tool.vertices},
        vertices(rest.size()) {
    for (const Position& p : rest)
      for (const float x : p) reach = std::max(reach, 2 * std::abs(double{x}));
    double extent = reach;
    for (const Position& p : object.vertices)
      for (const float x : p) extent = std::max(extent, std::abs(double{x}));
    clearance = 1e-6 * extent;
    set_planes(object.vertices, object.faces, object_planes);
    build(device, object_scene, object, RTC_BUILD_QUALITY_HIGH);
    build(device, tool_scene, tool, RTC_BUILD_QUALITY_REFIT);
  }

  void add(const RTCCollision& pair) noexcept {
    const Face &face = object.faces[pair.primID0], &triangle = tool.faces[pair.primID1];
    if (apart(object_planes[pair.primID0], vertices, triangle) ||
        apart(tool_planes[pair.primID1], object.vertices, face))
      return;
    for (int i = 0; i < 3; ++i) {
      const Position& f = object.vertices[face[i]];
      const std::array<double, 3>& g = vertices[triangle[i]];
      for (int axis = 0; axis < 3; ++axis) {
        pairs.object[i][axis][count] = f[axis];
        pairs.probe[i][axis][count] = g[axis];
      }
    }
    waiting[count] = pair;
    if (++count == spm::TrianglePairs::kWidth) flush();
  }

  /// All three corners are on one side of the plane: this rejects seven of eight pairs whose boxes overlap.
  template <class Vertices>
  [[nodiscard]] bool apart(const Plane& plane, const Vertices& of, const Face& face) const noexcept {
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (const std::uint32_t v : face) {
      const double off = plane[0] * of[v][0] + plane[1] * of[v][1] + plane[2] * of[v][2] - plane[3];
      low = std::min(low, off);
      high = std::max(high, off);
    }
    return low > clearance || high < -clearance;
  }

  template <class Vertices>
  static void set_planes(const Vertices& of, const std::vector<Face>& faces, std::vector<Plane>& planes) {
    planes.resize(faces.size());
    for (std::size_t f = 0; f < faces.size(); ++f) {
      const auto corner = [&](std::size_t k) {
        const auto& p = of[faces[f][k]];
        return Vec3d{p[0], p[1], p[2]};
      };
      const Vec3d a = corner(0), normal = (corner(1) - a).cross(corner(2) - a);
      const double length = normal.norm();
      const Vec3d unit = length > 0 ? Vec3d{normal / length} : Vec3d::Zero();
      planes[f] = {unit[0], unit[1], unit[2], unit.dot(a)};
    }
  }

  void flush() {
    for (unsigned hit = spm::meet(pairs, count, found, spm::best_simd()); hit != 0; hit &= hit - 1) {
      const auto lane = static_cast<unsigned>(__builtin_ctz(hit));
      out->push_back({spm::FaceId{waiting[lane].primID0},
                      waiting[lane].primID1,
                      true,
                      {found.point[0][lane], found.point[1][lane], found.point[2][lane]},
                      {found.normal[0][lane], found.normal[1][lane], found.normal[2][lane]},
                      found.depth[lane],
                      spm::RowIndex{waiting[lane].primID0}});
    }
    count = 0;
  }

  Device device;
  OneMesh object_scene{device, RTC_GEOMETRY_TYPE_USER, RTC_SCENE_FLAG_NONE, RTC_BUILD_QUALITY_HIGH};
  // The one combination that refits, in 11 us; a new tree takes 75 to 200 us.
  OneMesh tool_scene{device, RTC_GEOMETRY_TYPE_USER, RTC_SCENE_FLAG_DYNAMIC, RTC_BUILD_QUALITY_LOW};
  Triangles object, tool;                       // tool: as placed, rounded, for the boxes
  std::vector<Position> rest;                   // of the tool
  std::vector<std::array<double, 3>> vertices;  // of the tool as placed
  std::vector<Plane> object_planes, tool_planes;
  double reach = 0;      // max coordinate of the tool at rest
  double clearance = 0;  // beyond rounding, in a plane's test
  std::vector<spm::MeshContact>* out = nullptr;
  spm::TrianglePairs pairs{};
  spm::PairContacts found{};
  std::uint32_t count = 0;
  std::array<RTCCollision, spm::TrianglePairs::kWidth> waiting{};
};

EmbreeTool::EmbreeTool(EmbreePositions object_vertices, EmbreeFaces object_faces, EmbreePositions vertices,
                       EmbreeFaces triangles)
    : scenes_{std::make_unique<Scenes>(object_vertices, object_faces, vertices, triangles)} {}

EmbreeTool::~EmbreeTool() = default;

void EmbreeTool::touching(const Eigen::Isometry3d& pose, std::vector<spm::MeshContact>& out) {
  Scenes& s = *scenes_;
  out.clear();
  s.out = &out;
  const Eigen::Matrix3d r = pose.linear();
  const Vec3d t = pose.translation();
  s.tool.slack = static_cast<float>((t.cwiseAbs().maxCoeff() + s.reach) * kRounding);
  for (std::size_t v = 0; v < s.rest.size(); ++v)
    for (int i = 0; i < 3; ++i) {
      const double at = r(i, 0) * s.rest[v][0] + r(i, 1) * s.rest[v][1] + r(i, 2) * s.rest[v][2] + t[i];
      s.vertices[v][i] = at;
      s.tool.vertices[v][i] = static_cast<float>(at);
    }
  Scenes::set_planes(s.vertices, s.tool.faces, s.tool_planes);
  rtcCommitGeometry(s.tool_scene.geometry);
  rtcCommitScene(s.tool_scene.scene);
  rtcCollide(
      s.object_scene.scene, s.tool_scene.scene,
      [](void* user, RTCCollision* collisions, unsigned count) {
        for (unsigned i = 0; i < count; ++i) static_cast<Scenes*>(user)->add(collisions[i]);
      },
      &s);
  if (s.count > 0) s.flush();
}

}  // namespace tactus::bench
